"""What is known of a clip before the fit begins, and what the fit never changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL
from capture.detection.face_and_hands import ClipParts
from capture.detection.landmark_arrays import (
    hidden_for_long,
    hidden_joints,
    hidden_subtrees,
    interpolate_gaps,
    landmark_arrays,
    person_height_px,
)
from capture.detection.landmarks import Landmarks
from capture.detection.lifter import Lifter
from capture.detection.rigid_parts import rigid_parts
from capture.detection.scene_vertical import scene_vertical
from scene.arrays import Array, Float, Int, Tensor, UInt8

USUAL_FOCAL = 0.87
"""Focal length of phones and webcams, in longest sides of the picture (60 degrees)."""
_USUAL_RATE = 15.0
"""Frames a second up to which deviations of speeds hold."""


@dataclass(frozen=True, eq=False)
class PartObservations:
    """Head, left and right palm, by the landmarkers of faces and hands."""

    middles_px: Float[Tensor, "F 3 2"]
    palms_px: Float[Tensor, "F 2 5 2"]
    """Wrist and knuckles of the left and the right hand."""
    rotations: Float[Tensor, "F 3 3 3"]
    """From rest to the camera."""
    found: Float[Tensor, "F 3"]
    """1 where the middle is known,"""
    turned: Float[Tensor, "F 3"]
    """1 where the rotation is, too."""
    palms_found: Float[Tensor, "F 2"]
    """1 where the points of a palm are."""


@dataclass(frozen=True, eq=False)
class Observations:
    """One person in F frames: what was seen of them, and how far it is believed."""

    images: Sequence[UInt8[Array, "H W 3"]] | None
    """sRGB; None where motion between pictures is not to be looked at."""
    masks: Sequence[Float[Array, "H W"] | None]
    width: int
    """Of the pictures, px."""
    height: int
    times_s: Float[Array, "F"]
    takes: Int[Array, "F"]
    """Number of the continuous recording that each frame belongs to."""
    focal_px: float
    """Where known; else that of usual cameras."""
    focal_known: bool
    landmarks_px: Float[Tensor, "F 33 2"]
    landmarks_m: Float[Tensor, "F 33 3"]
    """The estimator's own 3D guess, axes of OpenGL's camera."""
    landmark_weights: Float[Tensor, "F 33"]
    """0 to 1."""
    lifted_rotations: Float[Tensor, "F 24 3 3"]
    """Local rotations as the lifter believes them; joint 0 to the camera frame."""
    lifted_spread_rad: Float[Tensor, "F 24"]
    hidden: Float[Tensor, "F 24"]
    """How far nothing shows each joint's rotation for long, 0 to 1."""
    shown: Float[Tensor, "F 24"]
    """1 for joints that something shows in the frame, as all joints above them."""
    steps_s: Float[Tensor, "F-1"]
    """Between neighbouring frames; infinite at cuts."""
    mid_steps_s: Float[Tensor, "F-2"]
    """Between the middles of neighbouring steps; infinite at cuts."""
    person_px: Float[Tensor, "F"]
    """About the standing person's height in the picture: the unit of deviations there."""
    parts: PartObservations | None = None
    """None where nobody looked at face and hands."""
    up: Float[Tensor, "3"] | None = None
    """The vertical (unit, camera frame), where lines of the scene show it."""

    @property
    def centre(self) -> Float[Tensor, "2"]:
        """Principal point, px."""
        return torch.tensor([0.5 * self.width, 0.5 * self.height])

    @property
    def step_s(self) -> float:
        """The usual time between frames."""
        return float(np.median(np.diff(self.times_s))) if len(self.times_s) > 1 else 1.0

    @property
    def rate_factor(self) -> float:
        """By how much deviations of speeds and accelerations grow with the frame rate.

        Frames close in time would hold each other by the fourth power of the rate, and so stiff a
        problem converges slowly.
        """
        return max(1.0, 1.0 / (_USUAL_RATE * self.step_s))


def observe(
    people: Sequence[Landmarks],
    masks: Sequence[Float[Array, "H W"] | None],
    times_s: Float[Array, "F"],
    takes: Int[Array, "F"],
    lifter: Lifter,
    *,
    focal_px: float | None = None,
    images: Sequence[UInt8[Array, "H W 3"]] | None = None,
    parts: ClipParts | None = None,
) -> Observations:
    """Observations of one person in frames that all show them; see `fit_clip` for the arguments."""
    height, width = next(mask.shape for mask in masks if mask is not None)
    focal = focal_px or USUAL_FOCAL * max(width, height)
    pixels, world, weights = landmark_arrays(people, width, height)
    centre = np.array([0.5 * width, 0.5 * height])
    lifted = lifter(*interpolate_gaps(people, times_s, takes), focal, centre)
    hidden = hidden_joints(weights)
    up = None if images is None else scene_vertical(images, masks, focal)
    steps, mid_steps = time_steps(times_s, takes)
    return Observations(
        images,
        masks,
        width,
        height,
        times_s,
        takes,
        focal,
        focal_px is not None,
        _tensor(pixels),
        _tensor(world * OPENCV_TO_OPENGL),
        _tensor(weights),
        _tensor(lifted.rotations),
        _tensor(lifted.spread_rad),
        _tensor(hidden_for_long(hidden, times_s, takes)),
        _tensor(1.0 - hidden_subtrees(hidden)),
        steps,
        mid_steps,
        _tensor(person_height_px(pixels, times_s, takes)),
        None if parts is None else _observed_parts(parts, focal, centre),
        None if up is None else _tensor(up),
    )


def time_steps(
    times_s: Float[Array, "F"], takes: Int[Array, "F"]
) -> tuple[Float[Tensor, "F-1"], Float[Tensor, "F-2"]]:
    """Steps between neighbours and between the middles of those, s; infinite at cuts."""
    steps = np.diff(times_s)
    middles = 0.5 * (steps[1:] + steps[:-1])
    cut = np.diff(takes) != 0
    middles = np.where(cut[1:] | cut[:-1], np.inf, middles)
    steps = np.where(cut, np.inf, steps)
    return _tensor(steps), _tensor(middles)


def _observed_parts(
    parts: ClipParts, focal_px: float, centre: Float[Array, "2"]
) -> PartObservations:
    found = rigid_parts(parts, focal_px, centre)
    return PartObservations(
        _tensor(found.middles_px),
        _tensor(found.palms_px),
        _tensor(found.rotations),
        _tensor(found.found),
        _tensor(found.turned),
        _tensor(found.palms_found),
    )


def _tensor(value: Array) -> Tensor:
    return torch.tensor(value, dtype=torch.float32)
