"""Rest joints from moving vertices: of bodies unlike the mean one, moved by real people."""

from __future__ import annotations

import numpy as np
import pytest

from capture.body.model import load_body_model
from capture.sources.bvh import read_bvh
from capture.sources.readers.joints import joints_from_vertices
from scene import Body, Pose, Skeleton
from tests.shared_data import shared_data

OFFSET = np.array([0.1, -0.3, 0.2])


def stretched(sides: tuple[float, float, float]) -> Body:
    """The mean body with other proportions: longer, narrower, ..."""
    body = load_body_model().body(np.zeros(5))
    assert body.rest_vertices is not None
    skeleton = Skeleton(body.skeleton.rest_joints * sides)
    return Body(skeleton, body.rest_vertices * sides, body.faces, body.blend_weights)


@pytest.mark.parametrize("clip", ["dance_indian_94_15", "walk_figure8_91_62", "wash_self_02_10"])
def test_joints_of_a_stretched_body_are_found(clip):
    body = stretched((0.9, 1.15, 1.1))
    motion = read_bvh(shared_data(f"mocap/{clip}.bvh"), body.skeleton)
    used = np.linspace(0, len(motion) - 1, 60).astype(int)
    angles = motion.joint_angles[used]
    angles[:, 0] = 0.0
    vertices = np.stack([body.posed_vertices(Pose(a, np.zeros(3)))[::12] for a in angles])
    found = joints_from_vertices(vertices + OFFSET, angles)
    off = np.linalg.norm(found - OFFSET - body.skeleton.rest_joints, axis=1)
    limbs = [1, 2, 4, 5, 7, 8, 16, 17, 18, 19]  # hips, knees, ankles, shoulders, elbows
    assert off[limbs].mean() < 0.015
    assert off.mean() < 0.025  # hands and toes never move in these clips: as on the mean body


def test_without_motion_the_mean_body_decides():
    body = load_body_model().body(np.zeros(5))
    angles = np.zeros((5, 24, 3))
    vertices = np.stack([body.posed_vertices(Pose(a, np.zeros(3)))[::12] for a in angles])
    found = joints_from_vertices(vertices, angles)
    np.testing.assert_allclose(found, body.skeleton.rest_joints, atol=0.01)
