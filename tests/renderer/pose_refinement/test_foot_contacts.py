"""Feet that stand are held at their height; those in the air, or never seen, are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.pose_refinement.foot_contacts import DEVIATION_M, FootContacts, sole_positions
from renderer.pose_refinement.photometry import POSE_PARAMETERS, apply_pose_step
from scene import Motion, Pose, Skeleton
from scene.skeleton import JOINT_NAMES
from tests.renderer.field.performer import body

FRAMES = 4
KNEE = JOINT_NAMES.index("left_knee")


def steps_up() -> Motion:
    """At rest, then with the left foot ever higher."""
    poses = []
    for frame in range(FRAMES):
        angles = np.zeros((len(JOINT_NAMES), 3))
        angles[KNEE, 0] = 0.5 * frame
        poses.append(Pose(angles, np.zeros(3), frame / 10.0))
    return Motion.from_poses(poses)


def heights(skeleton: Skeleton, poses: list[Pose]) -> np.ndarray:
    places = [skeleton.joint_transforms(p.joint_angles, p.root_translation) for p in poses]
    return sole_positions(skeleton, np.stack(places))[..., 1]


def test_feet_stand_that_are_on_the_floor_and_seen():
    motion = steps_up()
    standing = FootContacts.of(body().skeleton, motion)
    assert standing.contact[0] == pytest.approx(1.0)
    left, right = standing.contact[2:, :2], standing.contact[1:, 2:]
    assert (left < 0.1).all()
    assert right == pytest.approx(1.0)
    unseen = FootContacts.of(body().skeleton, replace(motion, confidence=0.0 * motion.confidence))
    assert (unseen.contact == 0.0).all()


def test_the_step_is_the_one_that_the_energys_derivatives_ask_for():
    skeleton, motion = body().skeleton, steps_up()
    standing = FootContacts.of(skeleton, motion)
    rng = np.random.default_rng(0)
    bobbing = 0.01 * rng.normal(size=(FRAMES, POSE_PARAMETERS))
    poses = [apply_pose_step(motion.pose(f), step) for f, step in enumerate(bobbing)]
    angles, root = (
        np.stack([getattr(p, name) for p in poses]) for name in ("joint_angles", "root_translation")
    )
    matrices, vectors = standing.equations(skeleton, angles, root)
    level = np.average(standing.heights - heights(skeleton, poses), weights=standing.contact)

    def energy(steps: np.ndarray) -> float:
        moved = [apply_pose_step(pose, step) for pose, step in zip(poses, steps, strict=True)]
        off = standing.heights - heights(skeleton, moved) - level
        return 0.5 * float((standing.contact * off**2).sum()) / DEVIATION_M**2

    for _ in range(4):
        along = rng.normal(size=(FRAMES, POSE_PARAMETERS))
        up, down, here = (energy(h * along) for h in (1e-4, -1e-4, 0.0))
        assert (down - up) / 2e-4 == pytest.approx((vectors * along).sum(), rel=1e-3)
        curved = np.einsum("fi,fij,fj", along, matrices, along)
        assert (up + down - 2.0 * here) / 1e-8 == pytest.approx(curved, rel=0.1)


def test_a_floor_that_is_lower_for_all_is_nobodys_fault():
    skeleton, motion = body().skeleton, steps_up()
    standing = FootContacts.of(skeleton, motion)
    lower = motion.root_translation - np.array([0.0, 0.02, 0.0])
    _, vectors = standing.equations(skeleton, motion.joint_angles, lower)
    assert np.abs(vectors).max() * DEVIATION_M**2 < 1e-6
