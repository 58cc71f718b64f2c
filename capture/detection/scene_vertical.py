"""Which way is up, by the straight lines of the scene.

Edges of doors, walls and furniture are mostly vertical, and vertical lines meet in one vanishing
point (Coughlan & Yuille 1999 find a camera's rotation by it). A line lies in a plane with the
camera, whose normal is level if the line is vertical: up is the direction that is at right angles
to the normals of most of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL, unit
from scene.arrays import Array, Float, UInt8

_FRAMES = 5
_SHORTEST = 1.0 / 16.0
"""Length of a line that counts, in heights of the picture."""
_STEEPEST, _FARTHEST_ROLL = np.deg2rad(35.0), np.deg2rad(12.0)
"""Pitch and roll that a camera is believed to have."""
_USUAL_PITCH, _USUAL_ROLL = np.deg2rad(15.0), np.deg2rad(4.0)
_OFF = np.deg2rad(1.5)
"""Of a vertical line's normal from level."""
_LONGEST_LINES = 60
_PERSON = 0.1
_ENOUGH, _SHARE = 1.2, 0.4
"""Length of the vertical lines, in heights of the picture and as a share of the steep ones."""
_DEVIATION = np.deg2rad(4.0)
"""Within which the pitch must be known, and frames must agree."""


def scene_vertical(
    images: Sequence[UInt8[Array, "H W 3"]],
    masks: Sequence[Float[Array, "H W"] | None],
    focal_px: float,
) -> Float[Array, "3"] | None:
    """The vertical (unit, up, axes of OpenGL's camera), or None where lines do not show it.

    `masks` hold the person, whose lines are left out. Frames must agree: a camera that is tilted
    within the clip has no one vertical.
    """
    chosen = np.unique(np.linspace(0, len(images) - 1, _FRAMES).round().astype(int))
    ups = [_frame_vertical(images[index], masks[index], focal_px) for index in chosen]
    found = np.array([up for up in ups if up is not None])
    if 2 * len(found) <= len(chosen):
        return None
    middle = unit(np.median(found, axis=0))
    agree = np.arccos(np.clip(found @ middle, -1.0, 1.0)) < _DEVIATION
    return middle if 2 * agree.sum() > len(chosen) else None


def _frame_vertical(
    image: UInt8[Array, "H W 3"], mask: Float[Array, "H W"] | None, focal_px: float
) -> Float[Array, "3"] | None:
    height, width = image.shape[:2]
    lines = _lines(image, mask)
    half = np.array([0.5 * width, 0.5 * height])
    ends = [np.c_[(lines[:, at] - half) / focal_px, np.ones(len(lines))] for at in (0, 1)]
    normals = unit(np.cross(*ends)) * OPENCV_TO_OPENGL
    lengths = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) / height
    return vertical_of(normals, lengths)


def vertical_of(
    normals: Float[Array, "N 3"], lengths: Float[Array, "N"]
) -> Float[Array, "3"] | None:
    """The vertical by which most of the lines are vertical.

    Args:
        normals: of the planes through the camera and each line, axes of OpenGL's camera.
        lengths: of the lines, in heights of the picture.
    """
    level = np.arcsin(np.clip(normals[:, 1], -1.0, 1.0))
    steep = np.abs(level) < _STEEPEST
    normals, lengths = normals[steep], lengths[steep]
    longest = np.argsort(-lengths)[:_LONGEST_LINES]
    first, second = np.triu_indices(len(longest), 1)
    crossed = np.cross(normals[longest[first]], normals[longest[second]])
    crossed *= np.sign(crossed[:, 1:2])
    apart = np.linalg.norm(crossed, axis=1) > np.sin(_DEVIATION)
    ups = unit(crossed[apart])
    pitch, roll = np.arcsin(ups[:, 2]), np.arctan2(ups[:, 0], ups[:, 1])
    usual = (np.abs(pitch) < _STEEPEST) & (np.abs(roll) < _FARTHEST_ROLL)
    if not usual.any():
        return None
    ups = ups[usual]
    prior = (pitch[usual] / _USUAL_PITCH) ** 2 + (roll[usual] / _USUAL_ROLL) ** 2
    scores = lengths @ _weights(normals @ ups.T) * np.exp(-0.5 * prior)
    up = ups[scores.argmax()]
    for _ in range(5):
        weights = lengths * _weights(normals @ up)
        information = (normals * weights[:, None]).T @ normals
        values, vectors = np.linalg.eigh(information)
        up = vectors[:, 0] * np.sign(vectors[1, 0])
    weights = lengths * _weights(normals @ up)
    known = values[1] / _OFF**2 > 1.0 / _DEVIATION**2
    enough = weights.sum() > max(_ENOUGH, _SHARE * lengths.sum())
    return up if known and enough else None


def _weights(off: Array) -> Array:
    """Of lines whose normals are off level by so much, 1 to 0."""
    return np.maximum(1.0 - (off / (2.0 * _OFF)) ** 2, 0.0) ** 2


def _lines(image: UInt8[Array, "H W 3"], mask: Float[Array, "H W"] | None) -> Float[Array, "N 2 2"]:
    """Both ends (px) of the long straight edges that are not the person's."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    found = cv2.createLineSegmentDetector().detect(grey)[0]
    lines = np.zeros((0, 2, 2)) if found is None else found.reshape(-1, 2, 2).astype(np.float64)
    lines = lines[np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) > _SHORTEST * len(grey)]
    if mask is None:
        return lines
    x, y = np.rint(lines.mean(axis=1)).astype(int).T
    inside = mask[y.clip(0, len(grey) - 1), x.clip(0, grey.shape[1] - 1)] > _PERSON
    return lines[~inside]
