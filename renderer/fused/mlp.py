"""A fully fused MLP as a function of torch tensors, with gradients for inputs and weights.

y = W_n relu(W_(n-1) ... relu(W_1 x)): no biases, all hidden layers of one width. Weights are single
precision masters; products run in half precision with sums in single (Mueller et al. 2021,
"Real-time neural radiance caching", sec. 4). The plain twin is `renderer.reference.mlp`.
"""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import torch
from torch.nn import functional

from renderer.errors import RendererError
from renderer.fused.tiny_cuda_nn import has_tiny_cuda_nn, tiny_cuda_nn_mlp
from scene.arrays import Float, Tensor

if TYPE_CHECKING:
    from collections.abc import Sequence

WIDTHS = (16, 32, 64, 128)
MOST_HIDDEN = 8
MOST_INPUTS = 128
MOST_OUTPUTS = 128
_TILE = 16
"""Side of the smallest product that tensor cores make; inputs are padded to its multiple."""
_BLOCK_ROWS = {16: 64, 32: 64, 64: 32, 128: 32}
"""Rows that one program carries through all layers, by width: as many as its registers hold."""
WARPS = 2
"""Of a program. With four, Triton (3.6) uses the products of Hopper's warp groups, and those of
layers of 64 units read outside their shared memory."""
_RUNS = 128
"""Most runs of rows whose weight gradients are summed apart, about one a multiprocessor."""
_LARGEST_DELTA = 2.0**6
"""Loss scaling: output gradients are scaled, by a power of two, to at most this in half precision.

Below lie 30 binary digits down to the smallest subnormal, above 10 for what hidden layers add."""


class NotFusible(RendererError):
    """A network that the fused kernels can't run."""


def require_fusible(shapes: Sequence[tuple[int, ...]], *, biased: bool = False) -> None:
    """Raise NotFusible unless weights of `shapes` ([out, in] each) make a fusible network."""
    inputs, width = shapes[0][1], shapes[0][0]
    problems = {
        f"be {', '.join(map(str, WIDTHS))} wide; got {width}": width not in WIDTHS,
        f"have 1 to {MOST_HIDDEN} hidden layers; got {len(shapes) - 1}": not (
            1 <= len(shapes) - 1 <= MOST_HIDDEN
        ),
        f"have 1 to {MOST_INPUTS} inputs; got {inputs}": not 1 <= inputs <= MOST_INPUTS,
        f"have 1 to {MOST_OUTPUTS} outputs; got {shapes[-1][0]}": not (
            1 <= shapes[-1][0] <= MOST_OUTPUTS
        ),
        f"keep one width; got layers of {list(shapes)}": any(
            shape[1] != width or (shape[0] != width and place < len(shapes) - 1)
            for place, shape in enumerate(shapes)
            if place
        ),
        "have no biases; got some": biased,
    }
    for rule, broken in problems.items():
        if broken:
            raise NotFusible(f"a fused network must {rule}; run it on the backend 'torch'")


@cache
def _interpreted() -> bool:
    """Whether Triton runs its kernels one by one on a CPU (TRITON_INTERPRET=1)."""
    if find_spec("triton") is None:
        return False
    from triton import knobs

    return bool(knobs.runtime.interpret)


def runs_on(device: torch.device) -> bool:
    """Whether a fused network runs on `device`: CUDA with Triton or tiny-cuda-nn, or a CPU where
    Triton's interpreter is asked for."""
    if device.type == "cuda":
        return find_spec("triton") is not None or has_tiny_cuda_nn()
    return device.type == "cpu" and _interpreted()


def fused_mlp(
    inputs: Float[Tensor, "N I"], weights: Sequence[Tensor], relu_last: bool = False
) -> Float[Tensor, "N O"]:
    """Outputs of the network with `weights` ([out, in] each, first to last).

    First derivatives exist for inputs and weights. Numbers past 65504 become infinite on the way,
    NaN stays NaN: neither turns into something that looks right.

    Raises:
        NotFusible: width, depth, inputs or outputs out of range.
    """
    require_fusible([tuple(w.shape) for w in weights])
    if len(inputs) == 0:
        return inputs.new_zeros(0, len(weights[-1])) + 0.0 * inputs.sum()
    if inputs.is_cuda and has_tiny_cuda_nn():
        return tiny_cuda_nn_mlp(inputs, weights, relu_last=relu_last)
    made: Tensor = _FusedMlp.apply(inputs, relu_last, *weights)
    return made


def _kernels() -> Any:
    """The Triton kernels, imported when first needed: renderer/ runs without Triton too."""
    from renderer.fused import mlp_kernels

    return mlp_kernels


class _FusedMlp(torch.autograd.Function):
    """Our own kernels behind torch's autograd."""

    @staticmethod
    def forward(ctx: Any, inputs: Tensor, relu_last: bool, *weights: Tensor) -> Tensor:
        x = inputs.detach().float().contiguous()
        packed = _packed(weights)
        rows, width, hidden = len(x), len(weights[0]), len(weights) - 1
        keep = any(ctx.needs_input_grad)
        y = x.new_empty(rows, len(weights[-1]))
        h = x.new_empty((hidden, rows, width) if keep else (1,), dtype=torch.float16)
        block = _BLOCK_ROWS[width]
        _kernels().forward[(_blocks(rows, block),)](
            x,
            *packed,
            h,
            y,
            rows,
            x.shape[1],
            y.shape[1],
            PADDED_INPUTS=packed[0].shape[0],
            WIDTH=width,
            PADDED_OUTPUTS=packed[2].shape[1],
            HIDDEN=hidden,
            KEEP=keep,
            RELU_LAST=relu_last,
            BLOCK=block,
            num_warps=WARPS,
        )
        ctx.save_for_backward(x, y, h, *packed)
        ctx.relu_last, ctx.hidden = relu_last, hidden
        return y

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        x, y, h, w_first, w_hidden, w_last = ctx.saved_tensors
        grad_y = grads[0].float().contiguous()
        rows, width, hidden = len(x), w_first.shape[1], ctx.hidden
        scale = _loss_scale(grad_y)
        delta = torch.empty_like(h)
        delta_last = h.new_empty(rows, w_last.shape[1])
        grad_x = torch.empty_like(x)
        block = _BLOCK_ROWS[width]
        _kernels().backward[(_blocks(rows, block),)](
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
            x.shape[1],
            y.shape[1],
            PADDED_INPUTS=w_first.shape[0],
            WIDTH=width,
            PADDED_OUTPUTS=w_last.shape[1],
            HIDDEN=hidden,
            FOR_INPUTS=ctx.needs_input_grad[0],
            RELU_LAST=ctx.relu_last,
            BLOCK=block,
            num_warps=WARPS,
        )
        for_weights = [_weight_gradient(x[None], delta[:1])[0]]
        if hidden > 1:
            for_weights += _weight_gradient(h[:-1], delta[1:]).unbind(0)
        for_weights.append(_weight_gradient(h[-1:], delta_last[None])[0][:, : y.shape[1]])
        unscaled = [(gradient / scale).T for gradient in for_weights]
        return grad_x if ctx.needs_input_grad[0] else None, None, *unscaled


def _packed(weights: Sequence[Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """First, hidden and last weights as the kernels read them: [in, out], padded, half."""
    first, *hidden, last = (w.detach().T for w in weights)
    first = functional.pad(first, (0, 0, 0, -len(first) % _TILE))
    wide = max(_TILE, 1 << (last.shape[1] - 1).bit_length())
    last = functional.pad(last, (0, wide - last.shape[1]))
    middle = torch.stack(hidden) if hidden else first[:1]
    one, two, three = (w.to(torch.float16).contiguous() for w in (first, middle, last))
    return one, two, three


def _loss_scale(gradient: Tensor) -> Float[Tensor, "1"]:
    """The power of two that brings the largest number of `gradient` just below the largest delta;
    1 where there is none or it is not finite."""
    largest = gradient.abs().amax().view(1)
    scale = torch.exp2(torch.floor(torch.log2(_LARGEST_DELTA / largest)))
    return torch.where(torch.isfinite(scale) & (scale > 0.0), scale, torch.ones_like(scale))


def _weight_gradient(
    value: Float[Tensor, "L N I"], delta: Float[Tensor, "L N O"]
) -> Float[Tensor, "L I O"]:
    """value^T delta of every layer, single precision."""
    layers, rows, wide_in = value.shape
    wide_out = delta.shape[2]
    block = 64
    runs = min(_RUNS, _blocks(rows, block))
    run = _blocks(_blocks(rows, runs), block) * block
    tile_in = min(64, max(_TILE, 1 << (wide_in - 1).bit_length()))
    tile_out = min(64, wide_out)
    partial = torch.empty(runs, layers, wide_in, wide_out, dtype=torch.float32, device=value.device)
    tiles = _blocks(wide_in, tile_in) * _blocks(wide_out, tile_out)
    _kernels().weight_gradient[(runs, tiles, layers)](
        value,
        delta,
        partial,
        rows,
        run,
        wide_in,
        wide_out,
        TILE_IN=tile_in,
        TILE_OUT=tile_out,
        BLOCK=block,
    )
    return partial.sum(dim=0)


def _blocks(count: int, size: int) -> int:
    return -(-count // size)
