"""Clips whose state is known, as a perfect estimator would see them, in float64.

Double precision, so that gradients can be held against finite differences.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch

from capture.body.model import load_body_model
from capture.fitting.kinematics import rotation_matrices
from capture.fitting.observations import Observations, time_steps
from capture.fitting.state import FitBody, FitState, PosedClip
from capture.fitting.term import Term
from scene.arrays import Array, Tensor

FRAMES, FRAMES_PER_SECOND = 4, 15.0
WIDTH, HEIGHT, FOCAL_PX, PERSON_PX = 480, 640, 500.0, 400.0
SPREAD_RAD = 0.3
"""By which the lifter says that its rotations are usually off."""
UNKNOWNS = ("joint_angles", "pelvis", "shape", "log_focal", "log_landmark_scale", "clothing_m")
UNKNOWNS += ("lifter_bias", "landmark_offsets", "tilt")


@contextmanager
def double_precision() -> Iterator[None]:
    """New tensors are float64, those that a term makes of its constants too."""
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    try:
        yield
    finally:
        torch.set_default_dtype(before)


@cache
def known_body() -> FitBody:
    """The body model."""
    body = FitBody(load_body_model())
    for name, value in vars(body).items():
        if isinstance(value, Tensor) and value.is_floating_point():
            setattr(body, name, value.double())
    return body


def known_state(frames: int = FRAMES, *, moves: bool = True) -> FitState:
    """Somebody about 3 m away, of another shape than the mean, who moves or holds one pose."""
    draw = torch.Generator().manual_seed(0)

    def noise(*shape: int, deviation: float) -> Tensor:
        return deviation * torch.randn(*shape, generator=draw, dtype=torch.float64)

    poses = frames if moves else 1
    angles = noise(poses, 24, 3, deviation=0.2)
    angles[:, 0] = 0.0
    with double_precision():
        root = rotation_matrices(noise(poses, 3, deviation=0.3))
        pelvis = torch.tensor([0.0, 0.1, -3.0]) + noise(poses, 3, deviation=0.05)
        return FitState(
            root.expand(frames, 3, 3).clone(),
            angles.expand(frames, 24, 3).clone(),
            pelvis.expand(frames, 3).clone(),
            noise(known_body().model.shape_count, deviation=0.05),
            log_focal=torch.zeros(()),
            log_landmark_scale=torch.zeros(()),
            clothing_m=torch.zeros(()),
            lifter_bias=torch.zeros(24, 3),
            landmark_offsets=torch.zeros(33, 3),
            floor_plane=torch.zeros(3),
            floor_origin=None,
            tilt=torch.zeros(2),
            frame_confidence=torch.ones(frames),
        )


def disturbed(state: FitState) -> FitState:
    """`state` with each unknown a little off."""
    draw = torch.Generator().manual_seed(1)

    def off(value: Tensor) -> Tensor:
        return value + 0.05 * torch.randn(value.shape, generator=draw, dtype=torch.float64)

    return replace(state, **{name: off(getattr(state, name)) for name in UNKNOWNS})


def seen_of(state: FitState, **changed: Any) -> Observations:
    """What a perfect estimator says of a clip of `state`, but for what is `changed`."""
    frames = len(state.joint_angles)
    times_s, takes = np.arange(frames) / FRAMES_PER_SECOND, np.zeros(frames, int)
    with double_precision():
        steps_s, mid_steps_s = timing(times_s, takes)
        blank = Observations(
            images=None,
            masks=[None] * frames,
            width=WIDTH,
            height=HEIGHT,
            times_s=times_s,
            takes=takes,
            focal_px=FOCAL_PX,
            focal_known=False,
            landmarks_px=torch.zeros(frames, 33, 2),
            landmarks_m=torch.zeros(frames, 33, 3),
            landmark_weights=torch.ones(frames, 33),
            lifted_rotations=state.local_rotations(),
            lifted_spread_rad=torch.full((frames, 24), SPREAD_RAD),
            hidden=torch.zeros(frames, 24),
            shown=torch.ones(frames, 24),
            steps_s=steps_s,
            mid_steps_s=mid_steps_s,
            person_px=torch.full((frames,), PERSON_PX),
        )
        clip = PosedClip(state, known_body(), blank)
        truth = {"landmarks_px": clip.project(clip.landmarks), "landmarks_m": clip.landmarks}
    return replace(blank, **{**truth, **changed})


def timing(times_s: Array, takes: Array) -> tuple[Tensor, Tensor]:
    """`time_steps` in float64."""
    steps_s, mid_steps_s = time_steps(times_s, takes)
    return steps_s.double(), mid_steps_s.double()


def energy_of(kind: type[Term], state: FitState, seen: Observations) -> float:
    """Of a term of `kind`, unweighted."""
    with double_precision():
        return kind(known_body(), seen).energy(PosedClip(state, known_body(), seen)).item()


def gradients_of(kind: type[Term], state: FitState, seen: Observations) -> dict[str, Tensor]:
    """Of that energy by each unknown; zeros where it has no part."""
    own = {name: getattr(state, name).clone().requires_grad_() for name in UNKNOWNS}
    with double_precision():
        clip = PosedClip(replace(state, **own), known_body(), seen)
        kind(known_body(), seen).energy(clip).backward()
    return {name: torch.zeros_like(x) if x.grad is None else x.grad for name, x in own.items()}


def assert_gradients_are_slopes(kind: type[Term], state: FitState, seen: Observations) -> None:
    """The gradient by each unknown is what finite differences find along a random direction."""
    draw, step = torch.Generator().manual_seed(2), 1e-6
    for name, gradient in gradients_of(kind, state, seen).items():
        value = getattr(state, name)
        along = torch.randn(value.shape, generator=draw, dtype=torch.float64)
        above, below = (
            energy_of(kind, replace(state, **{name: value + sign * step * along}), seen)
            for sign in (1.0, -1.0)
        )
        slope = (above - below) / (2.0 * step)
        assert (gradient * along).sum().item() == pytest.approx(slope, rel=1e-5, abs=1e-6), name
