"""The file from which a viewer's own device draws a person, little endian: 32 bytes for each splat
of its levels (`renderer.splats.levels`), the coarsest first, so that any beginning is a person.

Layout, also in docs/viewer-file.md:

    char[4] "MNSP", u16 version (7), u16 joints K, u32 splats N
    f32[3] lowest and f32[3] highest position (m), f32 lowest and f32 highest log scale (log m)
    f32[9 3] harmonics of the light that the person was recorded in, all nil where it is not known
    u32 blend shapes S, u32 offsets L, u32 roots R
    f32[K 3] joints at rest (m), i16[K] parents (-1: none)
    R records: u16[3] position, u8[3] log scale, u8 capture weight, u32 rotation, u8[3] colour,
               u8 opacity, u8[4] joints, u8[4] blend weights, u8[3] albedo, i8[3] normal
    N - R splits: u32 which record it replaces, and the two records that take its place
    of each blend shape u32 how many offsets it has, and f32 how far (m) 127 is among them
    u32[L] records that a blend shape moves, rising, one after the other; i8[L 3] how far

Positions and log scales run linearly from lowest to highest; colour and albedo (sRGB), opacity and
capture weight from 0 to 1; a normal, at rest and outwards, is 127 long; weights sum to 255; the
rotation is packed by `scene.smallest_three` in 10 bits a component. Colour is the mean as captured;
albedo and normal are what light falls on, a room's or that of the clip
(`renderer.relighting.shading`). The capture weight says how much of a splat was captured
(`renderer.splats.unseen`). The roots with the first n splits are a model of R + n splats; all N are
left where every split is done. At rest a splat lies at its position plus the sum over blend shapes,
in the order of `scene.expression`, of each weight times its offset; most splats that move do so
with one or two of them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from renderer.relighting.shading import albedo_of, normals_of
from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION, ROTATION
from renderer.splats.levels.tree import level_tree
from renderer.splats.model import SplatModel
from renderer.splats.unseen import capture_weight
from scene.arrays import Array, Float, UInt8
from scene.colour import to_srgb
from scene.lighting import HARMONICS
from scene.smallest_three import pack_quaternions

MAGIC, VERSION = b"MNSP", 7
ROTATION_BITS = 10
HEAD = struct.Struct(f"<4sHHI8f{3 * HARMONICS}fIII")
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
SPLIT = np.dtype([("replaced", "<u4"), ("records", RECORD, 2)])
_BLOCK = np.dtype([("count", "<u4"), ("far", "<f4")])
"""Of one blend shape."""


def write_viewer_file(model: SplatModel, path: Path) -> None:
    """Write `model` to `path`, whole or not at all."""
    part = path.with_name(path.name + ".part")
    part.write_bytes(encode(model))
    part.replace(path)


def encode(model: SplatModel) -> bytes:
    """The bytes of the file; the same for the same model."""
    tree = level_tree(model)
    nodes = tree.nodes.with_still_cloth()
    records = _records(nodes)
    p = nodes.parameters.astype(np.float64)
    position, log_scale = p[:, POSITION : POSITION + 3], p[:, LOG_SCALE : LOG_SCALE + 3]
    splits = np.zeros(len(tree.split), SPLIT)
    splits["replaced"] = tree.split
    splits["records"] = records[tree.fewest :].reshape(-1, 2)
    skeleton = model.skeleton
    light = np.zeros((HARMONICS, 3)) if model.light is None else model.light
    blocks, moved, offsets = _blend_shapes(nodes)
    head = HEAD.pack(
        MAGIC,
        VERSION,
        len(skeleton.names),
        len(model),
        *position.min(axis=0),
        *position.max(axis=0),
        float(log_scale.min()),
        float(log_scale.max()),
        *light.ravel(),
        len(blocks),
        len(moved),
        tree.fewest,
    )
    return b"".join(
        [
            head,
            skeleton.rest_joints.astype("<f4").tobytes(),
            np.array(skeleton.parents, "<i2").tobytes(),
            records[: tree.fewest].tobytes(),
            splits.tobytes(),
            blocks.tobytes(),
            moved.tobytes(),
            offsets.tobytes(),
        ]
    )


def _records(nodes: SplatModel) -> Array:
    """One `RECORD` for each."""
    p = nodes.parameters.astype(np.float64)
    position, log_scale = p[:, POSITION : POSITION + 3], p[:, LOG_SCALE : LOG_SCALE + 3]
    records = np.zeros(len(nodes), RECORD)
    records["position"] = _levels(position, position.min(axis=0), position.max(axis=0), 65535)
    records["log_scale"] = _levels(log_scale, log_scale.min(), log_scale.max(), 255)
    shown = capture_weight(nodes.parameters[:, POSITION : POSITION + 3], nodes.seen)
    records["capture_weight"] = _levels(shown, 0.0, 1.0, 255)
    records["rotation"] = pack_quaternions(p[:, ROTATION : ROTATION + 4], ROTATION_BITS)
    records["colour"] = _levels(p[:, COLOUR : COLOUR + 3], 0.0, 1.0, 255)
    records["opacity"] = _levels(1.0 / (1.0 + np.exp(-p[:, OPACITY])), 0.0, 1.0, 255)
    records["joints"], records["weights"] = nodes.joints, _whole_weights(nodes.weights)
    records["albedo"] = _levels(to_srgb(albedo_of(nodes)), 0.0, 1.0, 255)
    records["normal"] = np.rint(127.0 * normals_of(nodes))
    return records


def _blend_shapes(nodes: SplatModel) -> tuple[Array, Array, Array]:
    """Of each blend shape count and unit, then the records that move, and how far."""
    index, offsets = nodes.expression_splats, nodes.expression_offsets.transpose(1, 0, 2)
    rising = np.argsort(index)
    index, offsets = index[rising], offsets[:, rising]
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
