"""All poses of a clip, and the body they share, moved at once by one Gauss-Newton step.

Pixels say where each frame's body should go (`photometry`). What they leave open is held by the
estimate, by how bodies move (`scene.temporal`), and by the surface that the splats are drawn back
to: without it, the same rotation of a joint in every frame would be a body of another rest shape.

How far the estimate is to be trusted is not known: it may be exact, or off by many degrees. It is
read off the clip (evidence framework, MacKay 1992, eq. 4.9): the spread of the corrections is that
which the pixels, where they do say something, ask for. All terms are in nats: squares over
variances. Letters: F frames, S = `SHARED_PARAMETERS`, D = 75 + S; d steps of the poses, s of what
they share.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from renderer.pose_refinement.photometry import POSE_PARAMETERS, SHARED_PARAMETERS
from scene.arrays import Array, Float
from scene.temporal import ROOT_M_S2, ROTATION_RAD_S2, Accelerations

FIRST_SPREADS = (0.1, 0.1)
"""Deviations that are assumed before the first pass: of the corrections of turns (rad), and of
those of the root (m)."""
_SPREADS = (1e-3, 0.3)
"""The least and the most that may be read off a clip."""
_SHARED = np.append(np.full(SHARED_PARAMETERS - 1, 0.03), 0.005)
"""Deviations of the logarithms of bone lengths and focal length, in each frame: splats err alike in
all of them, so that many frames know no more of a bone's length than one."""
_ALIKE_PX = 4.0
"""Neighbouring pixels that are wrong alike: so many count as one."""
_ITERATIONS, _PRECISION = 60, 1e-2
_LARGEST = 0.25
"""rad and m: where a step's linear picture of the body ends."""
_PARTS = (slice(0, POSE_PARAMETERS - 3), slice(POSE_PARAMETERS - 3, POSE_PARAMETERS))
_USUAL = np.concatenate([np.full(POSE_PARAMETERS - 3, ROTATION_RAD_S2), np.full(3, ROOT_M_S2)])


@dataclass(frozen=True, eq=False)
class ClipNormalEquations:
    """What the pixels of all frames ask for."""

    matrices: Float[Array, "F D D"]
    vectors: Float[Array, "F D"]
    difference: float
    """Mean robust squared difference of colour a pixel of the person: the pixels' variance."""


@dataclass(frozen=True, eq=False)
class ClipState:
    """How far the clip has come from its estimate."""

    correction: Float[Array, "F 75"]
    """Turns in own frames (rad) and shifts of the root (m)."""
    shared: Float[Array, "S"]
    accelerations: Float[Array, "F 75"]
    """Of the poses as they stand."""
    held: tuple[Float[Array, "F 75 75"], Float[Array, "F 75"]]
    """Matrices and vectors of what else holds the poses: feet that stand."""
    spreads: Float[Array, "2"]
    """As in `FIRST_SPREADS`."""


@dataclass(frozen=True, eq=False)
class Step:
    """What one pass moves."""

    poses: Float[Array, "F 75"]
    shared: Float[Array, "S"]
    spreads: Float[Array, "2"]
    """Deviations that these corrections speak for."""


def solve(equations: ClipNormalEquations, state: ClipState, operator: Accelerations) -> Step:
    """The step to where pixels and priors agree, by conjugate gradients."""
    system = _System(equations, state, operator)
    d, s = _conjugate_gradients(system)
    d, s = np.clip(d, -_LARGEST, _LARGEST), np.clip(s, -_LARGEST, _LARGEST)
    determined = system.determined()
    corrected = ((state.correction + d) ** 2).sum(axis=0)
    spread = [np.sqrt(corrected[part].sum() / max(determined[part].sum(), 1.0)) for part in _PARTS]
    return Step(d, s, np.clip(spread, *_SPREADS))


class _System:
    """The normal equations with all priors, and their preconditioner."""

    def __init__(
        self, equations: ClipNormalEquations, state: ClipState, operator: Accelerations
    ) -> None:
        frames, trust = len(state.correction), 1.0 / (_ALIKE_PX * equations.difference + 1e-9)
        matrices, vectors = equations.matrices, equations.vectors
        held, pulled = state.held
        self._seen = trust * matrices[:, :POSE_PARAMETERS, :POSE_PARAMETERS]
        self._own, self._cross = (
            self._seen + held,
            trust * matrices[:, :POSE_PARAMETERS, POSE_PARAMETERS:],
        )
        shared = frames * _SHARED**-2.0
        self._across = trust * matrices[:, POSE_PARAMETERS:, POSE_PARAMETERS:].sum(
            axis=0
        ) + np.diag(shared)
        self._operator = operator
        self._estimate = np.repeat(state.spreads**-2.0, (POSE_PARAMETERS - 3, 3))
        squared = (state.accelerations / _USUAL).reshape(frames, -1, 3) ** 2
        robust = 1.0 / np.sqrt(1.0 + squared.mean(axis=2))
        self._steady = np.repeat(robust, 3, axis=1) / _USUAL**2
        self.right = (
            trust * vectors[:, :POSE_PARAMETERS]
            + pulled
            - self._estimate * state.correction
            - operator.transposed(self._steady * state.accelerations)
        )
        self.right_shared = trust * vectors[:, POSE_PARAMETERS:].sum(axis=0) - shared * state.shared
        diagonal = self._estimate + operator.diagonal(self._steady)
        self._inverse = np.linalg.inv(self._own + diagonal[:, :, None] * np.eye(POSE_PARAMETERS))
        self._inverse_shared = np.linalg.inv(self._across)

    def apply(self, d: Array, s: Array) -> tuple[Array, Array]:
        """The system's matrix times steps."""
        moved = (self._own @ d[..., None])[..., 0] + self._cross @ s + self._estimate * d
        moved += self._operator.transposed(self._steady * self._operator(d))
        return moved, np.einsum("fij,fi->j", self._cross, d) + self._across @ s

    def preconditioner_roots(self) -> tuple[Float[Array, "F 75 75"], Float[Array, "S S"]]:
        """W with W W^T nearly the inverse of the matrix: each frame by itself, what they share."""
        return np.linalg.cholesky(self._inverse), np.linalg.cholesky(self._inverse_shared)

    def determined(self) -> Float[Array, "75"]:
        """How much of each number, added up over the frames, pixels decide rather than priors."""
        return np.einsum("fij,fji->i", self._inverse, self._seen)


def _conjugate_gradients(system: _System) -> tuple[Array, Array]:
    """Steps that solve the system, by preconditioned conjugate gradients.

    The preconditioner W W^T is split, so that W^T A W y = W^T b is solved for x = W y and the norm
    in which residuals are judged is the preconditioned one.
    """
    from scipy.sparse import linalg

    root, root_shared = system.preconditioner_roots()
    frames, count = system.right.shape

    def unpacked(y: Array) -> tuple[Array, Array]:
        d, s = y[: frames * count].reshape(frames, count), y[frames * count :]
        return (root @ d[..., None])[..., 0], root_shared @ s

    def packed(r: Array, rs: Array) -> Array:
        whole = np.swapaxes(root, 1, 2) @ r[..., None]
        return np.concatenate([whole.ravel(), root_shared.T @ rs])

    right = packed(system.right, system.right_shared)
    operator: Any = linalg.LinearOperator  # scipy's annotations know subclasses of it alone
    size = len(right)
    matrix = operator(
        (size, size), matvec=lambda y: packed(*system.apply(*unpacked(y))), dtype=float
    )
    y, _ = linalg.cg(matrix, right, rtol=_PRECISION, maxiter=_ITERATIONS)
    return unpacked(y)
