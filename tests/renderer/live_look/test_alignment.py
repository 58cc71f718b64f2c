"""A pose is brought to a picture by what the picture can tell of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.live_look.alignment import FlowAligner, structure
from renderer.live_look.picture import WebcamPicture
from renderer.splats.model import SplatModel
from scene.motion import Pose
from scene.skeleton import HEAD
from tests.renderer.live_look.people import person_in_checks, seen_from


@pytest.fixture(scope="module")
def model() -> SplatModel:
    return person_in_checks()


def head_off_m(model: SplatModel, pose: Pose, truth: Pose) -> float:
    found, true = (
        model.skeleton.joint_transforms(one.joint_angles, one.root_translation)[HEAD, :3, 3]
        for one in (pose, truth)
    )
    return float(np.linalg.norm(found - true))


def aligned(model: SplatModel, picture: WebcamPicture, given: Pose, count: int = 8) -> Pose:
    """The pose after `count` pictures in which the landmarks say `given`."""
    aligner, pose = FlowAligner(model), given
    for _ in range(count):
        pose = aligner.align(replace(picture, pose=given), model.parameters)
    return pose


def test_a_movement_is_seen_across_edges_and_not_along_them():
    luma = np.zeros((40, 60), np.uint8)
    luma[:, 30:] = 200
    places = np.array([20, 20]), np.array([30, 8])
    edge, plain = structure(luma, *places)
    np.testing.assert_allclose(edge, np.diag([1.0, 0.0]), atol=0.05)
    assert np.abs(plain).max() < 1e-6


def test_a_pose_that_is_off_comes_nearer(model):
    picture = seen_from(model, 0.0)
    root = picture.pose.root_translation + np.array([0.03, 0.0, 0.0])
    off = replace(picture.pose, root_translation=root)
    assert head_off_m(model, aligned(model, picture, off), picture.pose) < 0.25 * 0.03


def test_nothing_drags_a_pose_away_where_nobody_is_seen(model):
    picture = seen_from(model, 0.0)
    black = replace(picture, rgb=np.zeros_like(picture.rgb), matte=np.zeros_like(picture.matte))
    assert head_off_m(model, aligned(model, black, picture.pose), picture.pose) < 1e-6
