"""The file from which a viewer's own device draws a person: 32 bytes a splat, little endian.

Layout, also in docs/viewer-file.md:

    char[4] "MNSP", u16 version (6), u16 joints K, u32 splats N
    f32[3] lowest and f32[3] highest position (m), f32 lowest and f32 highest log scale (log m)
    f32[9 3] harmonics of the light that the person was recorded in, all nil where it is not known
    u32 blend shapes S, u32 offsets L
    f32[K 3] joints at rest (m), i16[K] parents (-1: none)
    N records: u16[3] position, u8[3] log scale, u8 capture weight, u32 rotation, u8[3] colour,
               u8 opacity, u8[4] joints, u8[4] blend weights, u8[3] albedo, i8[3] normal
    of each blend shape u32 how many offsets it has, and f32 how far (m) 127 is among them
    u32[L] records that a blend shape moves, rising, one after the other; i8[L 3] how far

Positions and log scales run linearly from lowest to highest; colour and albedo (sRGB), opacity and
capture weight from 0 to 1; a normal, at rest and outwards, is 127 long; weights sum to 255; the
rotation is packed by `scene.smallest_three` in 10 bits a component. Colour is the mean as captured;
albedo and normal are what light falls on, a room's or that of the clip
(`renderer.relighting.shading`). The capture weight says how much of a splat was captured
(`renderer.splats.unseen`). Records come in order of importance: the first n alone are a model, once
their scales are multiplied by (N / n)^1/4; offsets of others are then left out. At rest a splat
lies at its position plus the sum over blend shapes, in the order of `scene.expression`, of each
weight times its offset; most splats that move do so with one or two of them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from renderer.relighting.shading import albedo_of, normals_of
from renderer.splats.files.importance import importance_order
from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION, ROTATION
from renderer.splats.model import SplatModel
from renderer.splats.unseen import capture_weight
from scene.arrays import Array, Float, Int, UInt8
from scene.colour import to_srgb
from scene.lighting import HARMONICS
from scene.smallest_three import pack_quaternions

MAGIC, VERSION = b"MNSP", 6
ROTATION_BITS = 10
HEAD = struct.Struct(f"<4sHHI8f{3 * HARMONICS}fII")
RECORD = np.dtype(
    [
        ("position", "<u2", 3),
        ("log_scale", "u1", 3),
        ("capture_weight", "u1"),
        ("rotation", "<u4"),
        ("colour", "u1", 3),
        ("opacity", "u1"),
        ("joints", "u1", 4),
        ("weights", "u1", 4),
        ("albedo", "u1", 3),
        ("normal", "i1", 3),
    ]
)
_BLOCK = np.dtype([("count", "<u4"), ("far", "<f4")])
"""Of one blend shape."""


def write_viewer_file(model: SplatModel, path: Path) -> None:
    """Write `model` to `path`, whole or not at all."""
    part = path.with_name(path.name + ".part")
    part.write_bytes(encode(model))
    part.replace(path)


def encode(model: SplatModel) -> bytes:
    """The bytes of the file; the same for the same model."""
    p = model.parameters.astype(np.float64)
    position, log_scale = p[:, POSITION : POSITION + 3], p[:, LOG_SCALE : LOG_SCALE + 3]
    low, high = position.min(axis=0), position.max(axis=0)
    thin, wide = float(log_scale.min()), float(log_scale.max())
    records = np.zeros(len(model), RECORD)
    records["position"] = _levels(position, low, high, 65535)
    records["log_scale"] = _levels(log_scale, thin, wide, 255)
    shown = capture_weight(model.parameters[:, POSITION : POSITION + 3], model.seen)
    records["capture_weight"] = _levels(shown, 0.0, 1.0, 255)
    records["rotation"] = pack_quaternions(p[:, ROTATION : ROTATION + 4], ROTATION_BITS)
    records["colour"] = _levels(p[:, COLOUR : COLOUR + 3], 0.0, 1.0, 255)
    records["opacity"] = _levels(1.0 / (1.0 + np.exp(-p[:, OPACITY])), 0.0, 1.0, 255)
    records["joints"], records["weights"] = model.joints, _whole_weights(model.weights)
    records["albedo"] = _levels(to_srgb(albedo_of(model)), 0.0, 1.0, 255)
    records["normal"] = np.rint(127.0 * normals_of(model))
    skeleton = model.skeleton
    light = np.zeros((HARMONICS, 3)) if model.light is None else model.light
    order = importance_order(model)
    blocks, moved, offsets = _blend_shapes(model, order)
    head = HEAD.pack(
        MAGIC,
        VERSION,
        len(skeleton.names),
        len(model),
        *low,
        *high,
        thin,
        wide,
        *light.ravel(),
        len(blocks),
        len(moved),
    )
    return b"".join(
        [
            head,
            skeleton.rest_joints.astype("<f4").tobytes(),
            np.array(skeleton.parents, "<i2").tobytes(),
            records[order].tobytes(),
            blocks.tobytes(),
            moved.tobytes(),
            offsets.tobytes(),
        ]
    )


def _blend_shapes(model: SplatModel, order: Int[Array, "N"]) -> tuple[Array, Array, Array]:
    """Of each blend shape count and unit, then the records that move, and how far."""
    place = np.empty(len(model), np.int64)
    place[order] = np.arange(len(model))
    index = place[model.expression_splats]
    rising = np.argsort(index)
    index, offsets = index[rising], model.expression_offsets[rising].transpose(1, 0, 2)
    far = np.abs(offsets).max(axis=(1, 2), initial=0.0)
    steps = np.rint(offsets * (127.0 / np.maximum(far, 1e-9))[:, None, None]).astype(np.int8)
    shape, row = np.nonzero(steps.any(axis=2))
    blocks = np.zeros(len(far), _BLOCK)
    blocks["count"], blocks["far"] = np.bincount(shape, minlength=len(far)), far
    return blocks, index[row].astype("<u4"), steps[shape, row]


def _levels(values: Array, low: Array | float, high: Array | float, steps: int) -> Array:
    """`values` from `low` to `high` as whole numbers from 0 to `steps`."""
    span = np.maximum(np.subtract(high, low), 1e-9)
    return np.rint((values - low) / span * steps).clip(0, steps)


def _whole_weights(weights: Float[Array, "N 4"]) -> UInt8[Array, "N 4"]:
    """Weights in 255ths whose rows sum to 255: what rounding left over goes to the largest."""
    levels = np.rint(weights * 255.0).astype(np.int64)
    rows = np.arange(len(levels))
    levels[rows, levels.argmax(axis=1)] += 255 - levels.sum(axis=1)
    return levels.astype(np.uint8)
