"""Upper bodies before pitched cameras: upright people are upright, and who bows still bows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from capture.body.model import load_body_model
from capture.detection.landmarks import Landmarks
from capture.fitting import fit as fitting
from capture.fitting.fit import fit_clip
from capture.fitting.observations import Observations, observe
from capture.fitting.world import OPENGL_TO_OPENCV, PlacedFit, place_in_world
from scene.arrays import Array
from scene.camera import Camera, orbit_camera
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix
from tests.capture.people import JOINT, LANDMARK, body, seen_by, standing

FRAMES = 4
MISTAKEN_RAD = 0.2
"""By which the estimator takes people to lean towards the camera."""


def camera(pitch_rad: float) -> Camera:
    """It sees head to hips, and looks up by `pitch_rad`."""
    return orbit_camera((0.0, 1.3, 0.0), 1.7, 0.0, -pitch_rad, 256, 224, 0.8)


def upper_body(view: Camera, motion: Motion, mistaken_rad: float) -> list[Landmarks]:
    """Landmarks of an estimator that is wrong about who leans how far."""
    turn = axis_angle_to_matrix(np.array([-mistaken_rad, 0.0, 0.0]))
    people = []
    for index in range(len(motion)):
        person = seen_by(view, body(), motion.pose(index))
        visibility = person.visibility.copy()
        visibility[LANDMARK["left_knee"] :] = 0.0
        people.append(replace(person, visibility=visibility, world=person.world @ turn.T))
    return people


def captured(
    monkeypatch: pytest.MonkeyPatch, view: Camera, people: list[Landmarks], motion: Motion
) -> PlacedFit:
    """What a scene whose lines show the vertical makes of it."""
    up = OPENGL_TO_OPENCV @ view.rotation @ np.array([0.0, 1.0, 0.0])

    def told(*args: Any, **options: Any) -> Observations:
        return replace(observe(*args, **options), up=torch.tensor(up, dtype=torch.float32))

    monkeypatch.setattr(fitting, "observe", told)
    fit = fit_clip(
        people,
        [person.mask for person in people],
        motion.times_s,
        [0] * len(people),
        load_body_model(),
        focal_px=view.focal_px,
    )
    assert fit.up @ up > np.cos(np.deg2rad(2.0))
    return place_in_world(fit, motion.times_s)


def bones(placed: PlacedFit, start: str, end: str) -> Array:
    """Directions (unit) in the world from one joint to another."""
    motion = placed.motion
    joints = placed.body.skeleton.joint_transforms(motion.joint_angles, motion.root_translation)
    bone = joints[:, JOINT[end], :3, 3] - joints[:, JOINT[start], :3, 3]
    return bone / np.linalg.norm(bone, axis=1, keepdims=True)


@pytest.mark.parametrize("pitch_rad", [0.25, -0.25])
def test_an_upright_person_before_a_pitched_camera_is_upright(monkeypatch, pitch_rad):
    """In all steps of a fit: what is left after fewer of them hangs on how a processor rounds."""
    motion, view = standing(FRAMES), camera(pitch_rad)
    placed = captured(monkeypatch, view, upper_body(view, motion, MISTAKEN_RAD), motion)
    lean = np.rad2deg(np.arccos(bones(placed, "pelvis", "neck")[:, 1]))
    assert lean.mean() < 2.0


@pytest.mark.usefixtures("fewer_steps")
def test_a_person_who_bows_still_bows(monkeypatch):
    """The prior takes much of a bow, for little tells of it without legs; it must not undo it."""
    motion, view = standing(FRAMES, frames_per_second=2.0), camera(0.1)
    angles = motion.joint_angles.copy()
    angles[FRAMES // 2 :, 0, 0] = 0.6
    bowing = replace(motion, joint_angles=angles)
    placed = captured(monkeypatch, view, upper_body(view, bowing, 0.0), bowing)
    forwards = np.rad2deg(np.arcsin(bones(placed, "pelvis", "neck")[:, 2]))
    assert np.abs(forwards[: FRAMES // 2]).max() < 5.0
    assert forwards[FRAMES // 2 :].min() > 8.0


@pytest.mark.usefixtures("fewer_steps")
def test_legs_that_nothing_shows_hang_straight_below_and_do_not_cross(monkeypatch):
    motion, view = standing(FRAMES), camera(0.25)
    placed = captured(monkeypatch, view, upper_body(view, motion, MISTAKEN_RAD), motion)
    for side in ("left", "right"):
        for start, end in (("hip", "knee"), ("knee", "ankle")):
            bone = bones(placed, f"{side}_{start}", f"{side}_{end}")
            assert np.rad2deg(np.arccos(-bone[:, 1])).max() < 5.0
