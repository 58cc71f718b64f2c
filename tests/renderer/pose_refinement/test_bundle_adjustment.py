"""The step is the one that the energy's derivatives ask for; trust is read off the clip."""

from __future__ import annotations

import numpy as np

from renderer.pose_refinement import bundle_adjustment
from renderer.pose_refinement.bundle_adjustment import ClipNormalEquations, ClipState, solve
from renderer.pose_refinement.photometry import POSE_PARAMETERS, SHARED_PARAMETERS
from scene.temporal import Accelerations

FRAMES, SIZE = 5, POSE_PARAMETERS + SHARED_PARAMETERS


def random_clip(strength: float = 1.0) -> tuple[ClipNormalEquations, ClipState, Accelerations]:
    rng = np.random.default_rng(0)
    half = strength * rng.normal(size=(FRAMES, SIZE, 40))
    feet = rng.normal(size=(FRAMES, POSE_PARAMETERS, 4))
    state = ClipState(
        0.02 * rng.normal(size=(FRAMES, POSE_PARAMETERS)),
        0.01 * rng.normal(size=SHARED_PARAMETERS),
        rng.normal(size=(FRAMES, POSE_PARAMETERS)),
        (feet @ np.swapaxes(feet, 1, 2), rng.normal(size=(FRAMES, POSE_PARAMETERS))),
        np.array([0.1, 0.05]),
    )
    equations = ClipNormalEquations(
        half @ np.swapaxes(half, 1, 2), 0.3 * rng.normal(size=(FRAMES, SIZE)), 0.05
    )
    return equations, state, Accelerations.of(np.arange(FRAMES) / 10.0)


def test_the_matrix_is_the_second_derivative_of_the_priors_and_pixels():
    equations, state, operator = random_clip()
    system = bundle_adjustment.RegularisedEquations(equations, state, operator)
    trust = 1.0 / (bundle_adjustment.CORRELATED_PX * equations.difference + 1e-9)
    robust = system.smoothness

    def energy(d: np.ndarray, s: np.ndarray) -> float:
        """Half the squares over variances, as the module tells them."""
        pixels = np.concatenate([d, np.tile(s, (FRAMES, 1))], axis=1)
        total = trust * (
            np.einsum("fi,fij,fj", pixels, equations.matrices, pixels)
            - 2.0 * (equations.vectors * pixels).sum()
        )
        matrices, vectors = state.contacts
        total += np.einsum("fi,fij,fj", d, matrices, d) - 2.0 * (vectors * d).sum()
        gone = state.correction + d
        total += (gone[:, :-3] ** 2).sum() / state.deviations[0] ** 2
        total += (gone[:, -3:] ** 2).sum() / state.deviations[1] ** 2
        total += (robust * (state.accelerations + operator(d)) ** 2).sum()
        total += FRAMES * (((state.shared + s) / bundle_adjustment.SHARED_DEVIATIONS) ** 2).sum()
        return 0.5 * total

    rng = np.random.default_rng(1)
    d, s = (
        0.1 * rng.normal(size=(FRAMES, POSE_PARAMETERS)),
        0.1 * rng.normal(size=SHARED_PARAMETERS),
    )
    moved, shared = system.apply(d, s)
    gradient, by_shared = moved - system.right, shared - system.right_shared
    for _ in range(8):
        along, along_shared = rng.normal(size=d.shape), rng.normal(size=SHARED_PARAMETERS)
        up = energy(d + 1e-4 * along, s + 1e-4 * along_shared)
        down = energy(d - 1e-4 * along, s - 1e-4 * along_shared)
        expected = (gradient * along).sum() + by_shared @ along_shared
        np.testing.assert_allclose((up - down) / 2e-4, expected, rtol=1e-6)


def test_the_step_solves_the_system():
    equations, state, operator = random_clip()
    system = bundle_adjustment.RegularisedEquations(equations, state, operator)
    d, s = bundle_adjustment.conjugate_gradients(system)
    moved, shared = system.apply(d, s)
    left = np.abs(system.right - moved).max()
    assert left < 0.05 * np.abs(system.right).max()
    assert np.abs(system.right_shared - shared).max() < 0.05 * np.abs(system.right_shared).max()


def test_corrections_that_pixels_do_not_ask_for_make_the_estimate_trusted():
    equations, state, operator = random_clip()
    quiet = ClipState(
        np.zeros((FRAMES, POSE_PARAMETERS)),
        np.zeros(SHARED_PARAMETERS),
        np.zeros((FRAMES, POSE_PARAMETERS)),
        (np.zeros((FRAMES, POSE_PARAMETERS, POSE_PARAMETERS)), np.zeros((FRAMES, POSE_PARAMETERS))),
        state.deviations,
    )
    calm = ClipNormalEquations(equations.matrices, 0.0 * equations.vectors, equations.difference)
    assert (solve(calm, quiet, operator).deviations < 0.1 * state.deviations).all()
    own = equations.matrices[:, :POSE_PARAMETERS, :POSE_PARAMETERS]
    wanted = 0.2 * np.random.default_rng(2).normal(size=(FRAMES, POSE_PARAMETERS))
    loud = np.zeros((FRAMES, SIZE))
    loud[:, :POSE_PARAMETERS] = np.einsum("fij,fj->fi", own, wanted)
    asked = ClipNormalEquations(equations.matrices, loud, equations.difference)
    assert (solve(asked, quiet, operator).deviations[0]) > 0.1
