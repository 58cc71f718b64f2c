"""The gradient by joint turns against finite differences; exact poses are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.splats.poses import PoseRefinement
from renderer.splats.settings import SplatSettings
from tests.renderer.studio import make_motion, make_sequence


def make_refinement() -> PoseRefinement:
    motion = make_motion(3)
    angles = motion.joint_angles + 0.3 * np.random.default_rng(0).normal(size=(3, 24, 3))
    return PoseRefinement(
        make_sequence(exact=False, motion=replace(motion, joint_angles=angles), frames=3),
        SplatSettings(),
    )


def test_gradient_matches_finite_differences():
    refinement, rng = make_refinement(), np.random.default_rng(1)
    wanted = rng.normal(size=(24, 3, 4))

    def loss() -> float:
        angles, root = refinement._pose(1)
        moved = refinement._skeleton.skinning_transforms(angles, root)
        return float((wanted * moved[:, :3]).sum())

    gradient = refinement._gradient(1, wanted)
    step = 1e-6
    for row in (0, 1, 4, 9, 16, 20, 24):  # the last row is the root's shift
        for axis in range(3):
            refinement._correction[1, row, axis] = step
            up = loss()
            refinement._correction[1, row, axis] = -step
            down = loss()
            refinement._correction[1, row, axis] = 0.0
            np.testing.assert_allclose(gradient[row, axis], (up - down) / (2 * step), atol=1e-4)


def test_exact_poses_stay():
    sequence = make_sequence(exact=True)
    refinement = PoseRefinement(sequence, SplatSettings())
    refinement.step(0, np.ones((24, 3, 4), np.float32), 0.5, 1.0)
    assert refinement.motion() is sequence.motion


def test_state_is_restored():
    refinement = make_refinement()
    before = refinement.state()
    refinement.step(1, np.ones((24, 3, 4), np.float32), 0.5, 1.0)
    moved = refinement.transforms(1)
    refinement.restore(before)
    assert np.abs(moved - refinement.transforms(1)).max() > 1e-4
