"""What docs/capture.md promises of people who do not stand there like a mannequin.

The upper body alone is in tests/capture/fitting/test_fit.py, what was never filmed in
tests/renderer/splats/test_unseen.py.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from capture.body.landmark_names import FACE_LANDMARKS
from capture.body.model import load_body_model
from capture.detection.landmarks import Landmarks
from capture.fitting.fit import fit_clip
from capture.fitting.result import Fit
from capture.fitting.world import OPENGL_TO_OPENCV, PlacedFit, place_in_world
from capture.quality import side_shares
from capture.segmentation.masks import refine_mask
from scene.arrays import Array
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix
from tests.capture.people import JOINT, LANDMARK, body, camera, picture, seen_by, standing

pytestmark = pytest.mark.usefixtures("fewer_steps")
FRAMES = 5


def fitted(motion: Motion, people: list[Landmarks], masks: list[Array] | None = None) -> Fit:
    masks = [person.mask for person in people] if masks is None else masks
    return fit_clip(
        people,
        masks,
        motion.times_s,
        [0] * len(people),
        load_body_model(),
        focal_px=camera().focal_px,
    )


def placed(fit: Fit, motion: Motion) -> PlacedFit:
    return place_in_world(fit, motion.times_s)


def people_of(motion: Motion) -> list[Landmarks]:
    return [seen_by(camera(), body(), motion.pose(i)) for i in range(len(motion))]


def gap_rad(fit: Fit, motion: Motion, joint: str) -> float:
    """Largest angle between a fitted and a true local turn."""
    ours, truth = (
        axis_angle_to_matrix(a[:, JOINT[joint]]) for a in (fit.joint_angles, motion.joint_angles)
    )
    cosine = 0.5 * (np.einsum("fij,fij->f", ours, truth) - 1.0)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)).max())


def test_who_sits_is_fitted_sitting():
    motion = standing(FRAMES)
    angles = motion.joint_angles.copy()
    angles[:, 0, 1] = 0.6  # half from the side, so that the thighs are seen
    for side in ("left", "right"):
        angles[:, JOINT[f"{side}_hip"], 0] = -1.45
        angles[:, JOINT[f"{side}_knee"], 0] = 1.5
    sitting = replace(motion, joint_angles=angles)
    fit = fitted(sitting, people_of(sitting))
    for name in ("left_knee", "right_knee", "left_hip", "right_hip"):
        assert gap_rad(fit, sitting, name) < 0.35, name
    world = placed(fit, sitting)
    assert world.legs_seen
    joints = world.body.skeleton.joint_transforms(
        world.motion.joint_angles, world.motion.root_translation
    )[..., :3, 3]
    trunk = joints[:, JOINT["neck"]] - joints[:, JOINT["pelvis"]]
    assert (trunk[:, 1] / np.linalg.norm(trunk, axis=1)).min() > 0.9  # upright on their chair


def test_who_is_turned_away_is_seen_from_behind():
    motion = standing(FRAMES)
    angles = motion.joint_angles.copy()
    angles[:, 0, 1] = np.pi
    away = replace(motion, joint_angles=angles)
    people = people_of(away)
    for person in people:
        person.visibility[:FACE_LANDMARKS] = 0.0
    fit = fitted(away, people)
    view = camera()
    truth = OPENGL_TO_OPENCV @ view.rotation @ axis_angle_to_matrix(away.joint_angles[:, 0])
    cosine = np.einsum("fij,fij->f", truth, axis_angle_to_matrix(fit.joint_angles[:, 0]))
    assert np.arccos(np.clip(0.5 * (cosine - 1.0), -1.0, 1.0)).max() < 0.25
    world = placed(fit, away)
    seen = replace(view, world_to_camera=world.world_to_camera)
    assert side_shares(world.motion, seen)["back"] == 1.0


def test_hands_at_the_body_stay_in_place():
    motion = standing(FRAMES)
    angles = motion.joint_angles.copy()
    for side, out in (("left", 1.0), ("right", -1.0)):
        angles[:, JOINT[f"{side}_shoulder"]] = [0.0, 0.0, -out * 1.4]
        angles[:, JOINT[f"{side}_elbow"]] = [0.0, -out * 0.2, 0.0]
    hanging = replace(motion, joint_angles=angles)
    people = people_of(hanging)
    fit = fitted(hanging, people)
    for name in ("left_wrist", "right_wrist", "left_elbow", "right_elbow"):
        assert np.nanmax(fit.landmark_error_px[:, LANDMARK[name]]) < 4.0, name
    for name in ("left_shoulder", "right_shoulder"):
        assert gap_rad(fit, hanging, name) < 0.4, name


def test_loose_clothes_make_a_wider_mask_not_a_giant():
    motion = standing(FRAMES)
    people = people_of(motion)
    wide = [cv2.dilate(person.mask, np.ones((9, 9), np.uint8)) for person in people]
    loose = fitted(motion, people, wide)
    height_m = loose.body.skeleton.height_m
    assert height_m == pytest.approx(body().skeleton.height_m, rel=0.05)
    for name in ("left_elbow", "right_elbow", "left_knee", "right_knee"):
        assert gap_rad(loose, motion, name) < 0.5, name
    # and the clothes stay in the mask: they are the person's
    dressed = replace(people[0], mask=wide[0])
    kept = refine_mask(picture(dressed), dressed)
    assert ((kept > 0.5) & (wide[0] > 0.5)).sum() > 0.97 * (wide[0] > 0.5).sum()
