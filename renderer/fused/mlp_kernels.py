"""The fully fused MLP in Triton: rows of inputs stay in registers from the first layer to the last.

Letters: x inputs, h_l hidden activations, z_l = h_(l-1) W_l, y outputs; D rows; a delta is dL/dz.
Weights come transposed ([in, out]) in half precision; products are of half precision numbers and
summed in single precision, which is what tensor cores do. ReLU lets NaN through, as torch's does.

Three kernels: forward; backward to deltas and input gradients; weight gradients from activations
and deltas, each program summing over a run of rows (no atomics: one seed gives one result).
"""

# pyright: reportGeneralTypeIssues=false
# (Triton's ranges are made for its own compiler)
from __future__ import annotations

import triton
import triton.language as tl


@triton.jit
def _relu(z):
    return tl.where(z < 0.0, 0.0, z)


@triton.jit
def forward(
    x,
    w_first,
    w_hidden,
    w_last,
    h,
    y,
    rows,
    inputs,
    outputs,
    PADDED_INPUTS: tl.constexpr,
    WIDTH: tl.constexpr,
    PADDED_OUTPUTS: tl.constexpr,
    HIDDEN: tl.constexpr,
    KEEP: tl.constexpr,
    RELU_LAST: tl.constexpr,
    BLOCK: tl.constexpr,
):
    """y [rows, outputs] of x [rows, inputs]; with KEEP also every h [HIDDEN, rows, WIDTH]."""
    row = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)[:, None]
    unit = tl.arange(0, WIDTH)[None, :]
    unit_in = tl.arange(0, WIDTH)[:, None]
    z = tl.zeros((BLOCK, WIDTH), tl.float32)
    for start in tl.static_range(0, PADDED_INPUTS, 16):
        column = start + tl.arange(0, 16)
        there = (row < rows) & (column[None, :] < inputs)
        part = tl.load(x + row * inputs + column[None, :], mask=there, other=0.0).to(tl.float16)
        z = tl.dot(part, tl.load(w_first + column[:, None] * WIDTH + unit), z)
    value = _relu(z).to(tl.float16)
    if KEEP:
        tl.store(h + row * WIDTH + unit, value, mask=row < rows)
    for layer in tl.static_range(1, HIDDEN):
        weights = tl.load(w_hidden + (layer - 1) * WIDTH * WIDTH + unit_in * WIDTH + unit)
        value = _relu(tl.dot(value, weights)).to(tl.float16)
        if KEEP:
            tl.store(h + (layer * rows + row) * WIDTH + unit, value, mask=row < rows)
    out = tl.arange(0, PADDED_OUTPUTS)[None, :]
    z = tl.dot(value, tl.load(w_last + unit_in * PADDED_OUTPUTS + out))
    if RELU_LAST:
        z = _relu(z)
    tl.store(y + row * outputs + out, z, mask=(row < rows) & (out < outputs))


@triton.jit
def backward(
    grad_y,
    y,
    h,
    w_first,
    w_hidden,
    w_last,
    scale,
    delta,
    delta_last,
    grad_x,
    rows,
    inputs,
    outputs,
    PADDED_INPUTS: tl.constexpr,
    WIDTH: tl.constexpr,
    PADDED_OUTPUTS: tl.constexpr,
    HIDDEN: tl.constexpr,
    FOR_INPUTS: tl.constexpr,
    RELU_LAST: tl.constexpr,
    BLOCK: tl.constexpr,
):
    """Deltas times `scale`, in half precision: of every hidden layer [HIDDEN, rows, WIDTH] and of
    the last [rows, PADDED_OUTPUTS]; with FOR_INPUTS also grad_x [rows, inputs], unscaled."""
    row = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)[:, None]
    unit = tl.arange(0, WIDTH)[None, :]
    unit_out = tl.arange(0, WIDTH)[:, None]
    out = tl.arange(0, PADDED_OUTPUTS)
    factor = tl.load(scale)
    there = (row < rows) & (out[None, :] < outputs)
    last = tl.load(grad_y + row * outputs + out[None, :], mask=there, other=0.0) * factor
    if RELU_LAST:
        made = tl.load(y + row * outputs + out[None, :], mask=there, other=0.0)
        last = tl.where(made <= 0.0, 0.0, last)
    change = last.to(tl.float16)
    tl.store(delta_last + row * PADDED_OUTPUTS + out[None, :], change, mask=row < rows)
    # W_l^T: the same numbers with their axes swapped
    back = tl.dot(change, tl.load(w_last + out[:, None] + unit * PADDED_OUTPUTS))
    for step in tl.static_range(0, HIDDEN):
        layer = HIDDEN - 1 - step
        at = (layer * rows + row) * WIDTH + unit
        active = tl.load(h + at, mask=row < rows, other=0.0)
        change = tl.where(active <= 0.0, 0.0, back).to(tl.float16)
        tl.store(delta + at, change, mask=row < rows)
        if layer > 0:
            swapped = w_hidden + (layer - 1) * WIDTH * WIDTH + unit_out + unit * WIDTH
            back = tl.dot(change, tl.load(swapped))
    if FOR_INPUTS:
        for start in tl.static_range(0, PADDED_INPUTS, 16):
            column = start + tl.arange(0, 16)[None, :]
            part = tl.dot(change, tl.load(w_first + unit_out + column * WIDTH))
            there = (row < rows) & (column < inputs)
            tl.store(grad_x + row * inputs + column, part / factor, mask=there)


@triton.jit
def weight_gradient(
    value,
    delta,
    partial,
    rows,
    run,
    wide_in,
    wide_out,
    TILE_IN: tl.constexpr,
    TILE_OUT: tl.constexpr,
    BLOCK: tl.constexpr,
):
    """value^T delta over one run of rows, one tile of one layer.

    Grid: (runs, tiles, layers). value [layers, rows, wide_in], delta [layers, rows, wide_out],
    partial [runs, layers, wide_in, wide_out].
    """
    tiles_out = tl.cdiv(wide_out, TILE_OUT)
    tile, layer = tl.program_id(1), tl.program_id(2).to(tl.int64)
    column_in = (tile // tiles_out) * TILE_IN + tl.arange(0, TILE_IN)[None, :]
    column_out = (tile % tiles_out) * TILE_OUT + tl.arange(0, TILE_OUT)[None, :]
    first = tl.program_id(0).to(tl.int64) * run
    total = tl.zeros((TILE_IN, TILE_OUT), tl.float32)
    for start in range(0, run, BLOCK):
        row = first + start + tl.arange(0, BLOCK).to(tl.int64)[:, None]
        at = layer * rows + row
        one = tl.load(
            value + at * wide_in + column_in, mask=(row < rows) & (column_in < wide_in), other=0.0
        )
        other = tl.load(
            delta + at * wide_out + column_out,
            mask=(row < rows) & (column_out < wide_out),
            other=0.0,
        )
        total = tl.dot(tl.trans(one.to(tl.float16)), other, total)
    place = (tl.program_id(0) * tl.num_programs(2) + layer) * wide_in + tl.trans(column_in)
    there = (tl.trans(column_in) < wide_in) & (column_out < wide_out)
    tl.store(partial + place * wide_out + column_out, total, mask=there)
