"""A reader of viewer files by their documented layout, and pictures to compare."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from renderer.model_files import load_model
from renderer.splats.layout import PARAMETERS
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene import Skeleton, orbit_camera
from scene.colour import to_linear
from scene.smallest_three import unpack_quaternions

DEMO = Path(__file__).parents[3] / "services" / "assets" / "demo.safetensors"
HEAD_BYTES = 164
"""Before joints and parents."""


def demo_model() -> SplatModel:
    """The demo's performer: a real training's 10,000 splats."""
    model = load_model(DEMO)
    assert isinstance(model, SplatModel)
    return model


def decode(data: bytes, like: SplatModel, share: float = 1.0) -> SplatModel:
    """The level of `share` of the splats in `data`; motion and the like are those of `like`."""
    magic, version, joints, count, *bounds = struct.unpack_from("<4sHHI8f", data)
    assert (magic, version) == (b"MNSP", 7)
    low, high, (thin, wide) = np.array(bounds[:3]), np.array(bounds[3:6]), bounds[6:]
    light = np.frombuffer(data, "<f4", 27, 44).reshape(9, 3)
    shapes, entries, roots = struct.unpack_from("<III", data, 152)
    rest = np.frombuffer(data, "<f4", 3 * joints, HEAD_BYTES).reshape(joints, 3)
    parents = tuple(np.frombuffer(data, "<i2", joints, HEAD_BYTES + 12 * joints).tolist())
    start = HEAD_BYTES + 14 * joints
    rows, until = read_levels(data)
    blocks = start + 32 * len(rows) + 4 * (count - roots)
    table = np.frombuffer(data, [("count", "<u4"), ("far", "<f4")], shapes, blocks)
    moved = np.frombuffer(data, "<u4", entries, blocks + 8 * shapes)
    steps = np.frombuffer(data, "i1", 3 * entries, blocks + 8 * shapes + 4 * entries)
    assert len(data) == blocks + 8 * shapes + 7 * entries
    assert table["count"].sum() == entries
    splats, row = np.unique(moved, return_inverse=True)
    shape = np.repeat(np.arange(shapes), table["count"])
    offsets = np.zeros((len(splats), shapes, 3), np.float32)
    offsets[row, shape] = steps.reshape(-1, 3) * (table["far"][shape, None] / 127.0)
    asked = max(roots, round(share * count))
    drawn = until > asked
    drawn[2 * asked - roots :] = False
    rows, place = rows[drawn], np.cumsum(drawn) - 1
    p = np.empty((len(rows), PARAMETERS))
    p[:, :3] = low + np.ascontiguousarray(rows[:, :6]).view("<u2") / 65535 * (high - low)
    p[:, 3:6] = thin + rows[:, 6:9] / 255 * (wide - thin)
    rotation = np.ascontiguousarray(rows[:, 10:14]).view("<u4")[:, 0].astype(np.int64)
    p[:, 6:10] = unpack_quaternions(rotation, 10)
    p[:, 10:13] = rows[:, 14:17] / 255
    opacity = np.clip(rows[:, 17] / 255, 1e-6, 1 - 1e-6)
    p[:, 13] = np.log(opacity / (1 - opacity))
    normals = rows[:, 29:32].copy().view(np.int8).astype(np.float32)
    return SplatModel(
        p.astype(np.float32),
        rows[:, 18:22].copy(),
        (rows[:, 22:26] / 255).astype(np.float32),
        rows[:, 9] == 255,
        Skeleton(rest, like.skeleton.names, parents),
        like.motion,
        like.data_hash,
        albedo=to_linear(rows[:, 26:29] / 255).astype(np.float32),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        light=light if light.any() else None,
        expression_splats=place[splats[drawn[splats]]].astype(np.int32),
        expression_offsets=offsets[drawn[splats]],
    )


def read_levels(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Records of all levels, [M 32] bytes, and from how many splats on each is replaced, [M]."""
    joints, count = struct.unpack_from("<HI", data, 6)
    roots, start = struct.unpack_from("<I", data, 160)[0], HEAD_BYTES + 14 * joints
    first = np.frombuffer(data, np.uint8, 32 * roots, start).reshape(roots, 32)
    table = np.frombuffer(data, np.uint8, 68 * (count - roots), start + 32 * roots).reshape(-1, 68)
    rows = np.concatenate([first, table[:, 4:].reshape(-1, 32)])
    until = np.full(len(rows), count + 1)
    until[np.ascontiguousarray(table[:, :4]).view("<u4")[:, 0]] = roots + 1 + np.arange(len(table))
    return rows, until


def pictures(model: SplatModel, views: int = 6, size: int = 256) -> np.ndarray:
    """The model from all sides in poses of its motion, [views size size 4]."""
    renderer, drawn = SplatRenderer((model,)), []
    for view in range(views):
        pose = model.motion.pose(view * len(model.motion) // views)
        upright = pose.root_translation * [0.0, 1.0, 0.0]
        transforms = model.skeleton.skinning_transforms(pose.joint_angles, upright)
        camera = orbit_camera((0, 0.9, 0), 3.2, 2 * np.pi * view / views, 0.1, size, size)
        drawn.append(renderer.render(camera, [transforms]).copy())
    return np.array(drawn)


def psnr_on_body(made: np.ndarray, truth: np.ndarray) -> float:
    """dB over the pixels on which `truth` shows anything."""
    body = truth[..., 3] > 0
    return float(-10 * np.log10(((made - truth)[..., :3][body] ** 2).mean()))
