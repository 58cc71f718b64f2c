"""The unknowns of the fit: where they start, and the body that they make."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.body.landmarks import MIRROR
from capture.body.model import load_body_model
from capture.fitting.observations import Observations
from capture.fitting.state import FitBody, FitState, PosedClip, initial_state, outlying
from scene.arrays import Tensor
from scene.rotations import axis_angle_to_matrix
from tests.capture.fitting.known_clips import (
    FOCAL_PX,
    double_precision,
    known_body,
    known_state,
    seen_of,
)

FRAMES = 4


@pytest.fixture(scope="module")
def body() -> FitBody:
    return FitBody(load_body_model())


def single(seen: Observations) -> Observations:
    """`seen` in the single precision of the fit."""
    tensors = {name: x.float() for name, x in vars(seen).items() if isinstance(x, Tensor)}
    return replace(seen, **tensors)


@pytest.fixture(scope="module")
def truth() -> FitState:
    mean = known_state(FRAMES)
    return replace(mean, shape=torch.zeros_like(mean.shape))


@pytest.fixture
def start(body, truth) -> FitState:
    return initial_state(body, single(seen_of(truth)))


def test_it_starts_from_the_lifters_poses_where_landmarks_were_seen(body, truth, start):
    np.testing.assert_allclose(start.local_rotations().detach(), truth.local_rotations(), atol=1e-5)
    np.testing.assert_allclose(start.pelvis.detach(), truth.pelvis, atol=2e-3)
    clip = PosedClip(start, body, single(seen_of(truth)))
    assert clip.reprojection_error_px.abs().max() < 0.5


def test_landmarks_that_were_not_seen_do_not_say_where_it_starts(body, truth):
    seen = seen_of(truth)
    seen.landmarks_px[:, 25:] += 300.0
    seen.landmark_weights[:, 25:] = 0.0
    start = initial_state(body, single(seen))
    np.testing.assert_allclose(start.pelvis.detach(), truth.pelvis, atol=5e-3)


def test_the_optimiser_moves_every_unknown_but_the_roots_start(start):
    fixed = [
        name
        for name, value in vars(start).items()
        if isinstance(value, Tensor) and not value.requires_grad
    ]
    assert fixed == ["root_rotations", "frame_confidence"]


def test_the_root_turns_from_where_it_started(start):
    with torch.no_grad():
        start.joint_angles[:, 0, 1] = 0.3
        turned = start.local_rotations()[:, 0]
    own = torch.tensor(axis_angle_to_matrix(np.array([0.0, 0.3, 0.0])), dtype=torch.float32)
    np.testing.assert_allclose(turned, start.root_rotations @ own, atol=1e-6)


@settings(max_examples=20)
@given(st.integers(0, 2**16))
def test_poses_come_back_as_they_were_set(seed):
    rng = np.random.default_rng(seed)
    state = replace(
        known_state(FRAMES),
        root_rotations=torch.eye(3).repeat(FRAMES, 1, 1),
        joint_angles=torch.zeros(FRAMES, 24, 3),
        pelvis=torch.zeros(FRAMES, 3),
    )
    angles, pelvis = rng.uniform(-1.5, 1.5, (2, 24, 3)), rng.normal(size=(2, 3))
    state.set_poses(np.array([0, 3]), angles, pelvis)
    np.testing.assert_allclose(state.whole_angles()[[0, 3]], angles, atol=1e-5)
    np.testing.assert_allclose(state.pelvis[[0, 3]], pelvis, atol=1e-6)
    assert not state.joint_angles[:, 0].any()
    np.testing.assert_allclose(state.whole_angles()[1:3], 0.0, atol=1e-6)
    assert not state.pelvis[1:3].any()


def test_landmarks_lie_off_the_models_alike_on_both_sides():
    state, body = known_state(), known_body()
    usual = body.rest_landmarks(state)
    offsets = torch.randn(33, 3, generator=torch.Generator().manual_seed(0)).double()
    own = body.rest_landmarks(replace(state, landmark_offsets=offsets)) - usual
    np.testing.assert_allclose(own[list(MIRROR)], own * torch.tensor([-1.0, 1.0, 1.0]), atol=1e-12)
    np.testing.assert_allclose(own[0, 0], 0.0, atol=1e-12)  # the nose stays in the middle
    mirrored = 0.5 * (own + own[list(MIRROR)] * torch.tensor([-1.0, 1.0, 1.0]))
    alike = body.rest_landmarks(replace(state, landmark_offsets=mirrored)) - usual
    np.testing.assert_allclose(alike, own, atol=1e-12)


def test_a_longer_focal_length_moves_pixels_away_from_the_centre():
    state = known_state()
    longer = replace(state, log_focal=torch.tensor(np.log(1.25)))
    with double_precision():
        seen = seen_of(state)
        near, far = (PosedClip(s, known_body(), seen) for s in (longer, state))
        assert near.focal_px.item() == pytest.approx(1.25 * FOCAL_PX)
        np.testing.assert_allclose(
            near.project(near.landmarks) - seen.centre,
            1.25 * (far.project(far.landmarks) - seen.centre),
        )


def test_frames_are_outlying_beside_the_others_of_their_clip():
    energies = np.array([1.0, 1.1, 0.9, 5.0, 1.0])
    assert outlying(energies, 3.0).tolist() == [False, False, False, True, False]
    assert outlying(100.0 * energies, 3.0).tolist() == [False, False, False, True, False]
    assert not outlying(energies, 6.0).any()
