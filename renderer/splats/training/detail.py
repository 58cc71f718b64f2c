"""How finely frames show each part of a body: where splats are worth having, and how many."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Bool, Float
from scene.sequence import FrameSource, Sequence

_FRAMES = 16
"""Frames looked at, spread evenly."""
_FACING = 0.15
"""Least cosine between surface and view: at a grazing angle a pixel is no part's own."""


def shown_density(sequence: Sequence) -> Float[Array, "T"]:
    """Pixels a square metre, seen square on, at which the frames show each triangle of the rest
    surface: the mean over those in which it faces the camera inside the mask; 0 where none does.

    What stands in front of a triangle is not looked at: over a clip, little stays hidden.
    """
    body, source = sequence.body, sequence.train
    assert body.faces is not None
    total, frames = np.zeros(len(body.faces)), np.zeros(len(body.faces))
    for index in _some(source):
        camera, pose = source.camera(index), source.pose(index)
        corners = body.posed_vertices(pose)[body.faces]
        middle = corners.mean(axis=1)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        towards = camera.position - middle
        lengths = np.linalg.norm(normal, axis=1) * np.linalg.norm(towards, axis=1)
        facing = np.einsum("tx,tx->t", normal, towards) > _FACING * lengths
        pixels, depth = camera.project(middle)
        shown = facing & (depth > 0.0) & _inside(source.mask(index), pixels)
        total[shown] += (camera.focal_px / depth[shown]) ** 2
        frames[shown] += 1.0
    return total / np.maximum(frames, 1.0)


def _some(source: FrameSource) -> list[int]:
    return np.unique(np.linspace(0, len(source) - 1, _FRAMES).round().astype(int)).tolist()


def _inside(mask: Float[Array, "H W"], pixels: Float[Array, "T 2"]) -> Bool[Array, "T"]:
    height, width = mask.shape
    within = ((pixels >= 0.0) & (pixels < np.array([width, height]))).sum(axis=1) == 2
    column, row = np.clip(pixels.astype(int), 0, [width - 1, height - 1]).T
    return within & (mask[row, column] > 0.5)
