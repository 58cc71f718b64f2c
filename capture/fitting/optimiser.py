"""Gradient descent on all temporal scales of a motion at once.

Terms couple neighbouring frames: smoothness, feet and flow let one of them move by itself only a
little a step, so that errors which last for seconds would take thousands of steps. In a
hierarchical basis (Szeliski 1990: hat functions, wide ones over narrow ones) each step also moves
spans of a third of a second and of a whole one. Adam (Kingma & Ba 2015) scales every coefficient.

Somebody close by moves as much shorter a way as they are nearer than at their farthest: steps of
three centimetres would throw a face that fills the picture off its outline for good.
"""

from __future__ import annotations

import numpy as np
import torch

from capture.fitting.observations import Observations
from capture.fitting.state import FitState
from scene.arrays import Array, Float, Int, Tensor

_HATS = ((0.3, 0.6), (1.1, 0.4))
"""Width of the hats on each side, s, and how far they move beside single frames."""
_FINAL_RATE_SHARE = 0.05
"""Share of the rate that is left at the end."""
_BETAS, _EPSILON = (0.9, 0.99), 1e-5


class Descent:
    """Adam on a fit's state, whose motion moves along a hierarchical basis as well."""

    def __init__(self, state: FitState, seen: Observations, rate: float) -> None:
        """Steps of about `rate` (rad and m) at first."""
        basis = hierarchical_basis(seen.times_s, seen.takes)
        nearness = seen.person_px.min() / seen.person_px
        self.bases = (basis, nearness[:, None] * basis)
        """Of joint angles and of the pelvis."""
        self._motion = (state.joint_angles, state.pelvis)
        # moved along the bases, and zero again after each step
        self._coefficients = [x.new_zeros(basis.shape[1], *x.shape[1:]) for x in self._motion]
        groups = [
            (self._coefficients[0], rate),
            (self._coefficients[1], rate),
            (state.shape, 0.4 * rate),
            (state.lifter_bias, 0.3 * rate),
            (state.landmark_offsets, 0.1 * rate),
            (state.log_landmark_scale, 0.3 * rate),
            (state.clothing_m, 0.03 * rate),
            (state.floor_plane, 0.3 * rate),
            (state.tilt, 0.3 * rate),
        ]
        if not seen.focal_known:
            groups.append((state.log_focal, 0.2 * rate))
        self._adam = Adam(groups)

    def step(self, energy: Tensor, done: float) -> None:
        """One step down `energy`; `done` is the share of steps before it, by which they shorten."""
        for unknown in (*self._motion, *self._adam.unknowns):
            unknown.grad = None
        energy.backward()
        motion = tuple(zip(self._coefficients, self._motion, self.bases, strict=True))
        for coefficients, unknown, basis in motion:
            coefficients.grad = torch.tensordot(basis.T, unknown.grad, 1)
        self._adam.step(1.0 - (1.0 - _FINAL_RATE_SHARE) * done)
        with torch.no_grad():
            for coefficients, unknown, basis in motion:
                unknown += torch.tensordot(basis, coefficients, 1)
                coefficients.zero_()


class Adam:
    """Kingma & Ba 2015, algorithm 1. PyTorch's own loads its compiler first: 3.5 s a process."""

    def __init__(self, groups: list[tuple[Tensor, float]]) -> None:
        self.unknowns = [unknown for unknown, _ in groups]
        self._rates = [rate for _, rate in groups]
        self._means = [torch.zeros_like(unknown) for unknown in self.unknowns]
        self._squares = [torch.zeros_like(unknown) for unknown in self.unknowns]
        self._steps = [0] * len(groups)

    @torch.no_grad()
    def step(self, rate_share: float) -> None:
        """One step along the gradients, of this share of the rates; what has none stays."""
        for index, unknown in enumerate(self.unknowns):
            if unknown.grad is None:
                continue
            mean, square = self._means[index], self._squares[index]
            mean.lerp_(unknown.grad, 1.0 - _BETAS[0])
            square.lerp_(unknown.grad.square(), 1.0 - _BETAS[1])
            self._steps[index] += 1
            unbiased = [1.0 - beta ** self._steps[index] for beta in _BETAS]
            deviation = (square / unbiased[1]).sqrt_().add_(_EPSILON)
            unknown.addcdiv_(mean, deviation, value=-rate_share * self._rates[index] / unbiased[0])


def hierarchical_basis(times_s: Float[Array, "F"], takes: Int[Array, "F"]) -> Float[Tensor, "F C"]:
    """Every frame by itself, then ever wider hats in time, none across a cut."""
    columns = [np.eye(len(times_s))]
    for width_s, share in _HATS:
        for take in np.unique(takes):
            here = takes == take
            first, last = times_s[here][[0, -1]]
            knots = np.arange(first, last + width_s, width_s)
            hats = np.maximum(1.0 - np.abs(times_s[:, None] - knots) / width_s, 0.0)
            columns.append(share * hats * here[:, None])
    return torch.tensor(np.concatenate(columns, axis=1), dtype=torch.float32)
