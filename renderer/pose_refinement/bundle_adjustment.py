"""One Gauss-Newton step of all poses of a clip and of the body they share.

The data term is photometric (`photometry`). Priors are the estimate, smooth motion
(`scene.temporal`), and the surface that the splats are pulled to: without it, the same rotation of
a joint in every frame would be equivalent to another rest shape.

The error of the estimate is not known: it may be exact, or off by many degrees. It is inferred from
the clip (evidence framework, MacKay 1992, eq. 4.9): the deviation of the corrections is that of the
parameters that the pixels determine. All terms are in nats: squares over
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

INITIAL_DEVIATIONS = (0.1, 0.1)
"""Deviations assumed before the first pass: of the corrections of rotations (rad) and of the root
(m)."""
GIVEN_DEVIATIONS = (0.035, 0.01)
"""The same for poses that came with the data: good estimators are off by two degrees."""
_DEVIATION_RANGE = (1e-3, 0.3)
"""Range of the inferred deviations."""
SHARED_DEVIATIONS = np.append(np.full(SHARED_PARAMETERS - 1, 0.03), 0.005)
"""Deviations of the logarithms of bone lengths and focal length, in each frame: the splats'
errors are common to all, so that many frames determine a bone's length no better than one."""
CORRELATED_PX = 4.0
"""Neighbouring pixels with correlated errors, which count as one."""
_ITERATIONS, _PRECISION = 60, 1e-2
_MAX_STEP = 0.25
"""rad and m: limit of the linearisation."""
_PARTS = (slice(0, POSE_PARAMETERS - 3), slice(POSE_PARAMETERS - 3, POSE_PARAMETERS))
_ACCELERATION_DEVIATIONS = np.concatenate(
    [np.full(POSE_PARAMETERS - 3, ROTATION_RAD_S2), np.full(3, ROOT_M_S2)]
)


@dataclass(frozen=True, eq=False)
class ClipNormalEquations:
    """Photometric normal equations of all frames."""

    matrices: Float[Array, "F D D"]
    vectors: Float[Array, "F D"]
    difference: float
    """Mean robust squared difference of colour a pixel of the person: the pixels' variance."""


@dataclass(frozen=True, eq=False)
class ClipState:
    """Corrections so far, and priors of the next step."""

    correction: Float[Array, "F 75"]
    """Rotations in own frames (rad) and shifts of the root (m)."""
    shared: Float[Array, "S"]
    accelerations: Float[Array, "F 75"]
    """Of the current poses."""
    contacts: tuple[Float[Array, "F 75 75"], Float[Array, "F 75"]]
    """Matrices and vectors of the foot contacts."""
    deviations: Float[Array, "2"]
    """As in `INITIAL_DEVIATIONS`."""


@dataclass(frozen=True, eq=False)
class Step:
    """Step of one pass."""

    poses: Float[Array, "F 75"]
    shared: Float[Array, "S"]
    deviations: Float[Array, "2"]
    """Inferred deviations of the corrections."""


def solve(equations: ClipNormalEquations, state: ClipState, operator: Accelerations) -> Step:
    """The step that minimises data term and priors, by conjugate gradients."""
    system = RegularisedEquations(equations, state, operator)
    d, s = conjugate_gradients(system)
    d, s = np.clip(d, -_MAX_STEP, _MAX_STEP), np.clip(s, -_MAX_STEP, _MAX_STEP)
    determined = system.determined()
    squared = ((state.correction + d) ** 2).sum(axis=0)
    spread = [np.sqrt(squared[part].sum() / max(determined[part].sum(), 1.0)) for part in _PARTS]
    return Step(d, s, np.clip(spread, *_DEVIATION_RANGE))


def in_given_gauge(step: Step, state: ClipState) -> Step:
    """`step` without what would move the whole model against the poses that drive it: the mean of
    each correction over the clip stays nil, and so do bone lengths and focal length.

    Pixels cannot tell a rotation that is the same in every frame from another rest shape; left
    free, the model drifts until given poses no longer fit it.
    """
    drift = (state.correction + step.poses).mean(axis=0)
    return Step(step.poses - drift, np.zeros_like(step.shared), step.deviations)


class RegularisedEquations:
    """The normal equations with all priors, and their preconditioner."""

    def __init__(
        self, equations: ClipNormalEquations, state: ClipState, operator: Accelerations
    ) -> None:
        frames, precision = (
            len(state.correction),
            1.0 / (CORRELATED_PX * equations.difference + 1e-9),
        )
        matrices, vectors = equations.matrices, equations.vectors
        contact_matrices, contact_vectors = state.contacts
        self._data = precision * matrices[:, :POSE_PARAMETERS, :POSE_PARAMETERS]
        self._frame_matrices, self._cross = (
            self._data + contact_matrices,
            precision * matrices[:, :POSE_PARAMETERS, POSE_PARAMETERS:],
        )
        shared = frames * SHARED_DEVIATIONS**-2.0
        self._shared_matrix = precision * matrices[:, POSE_PARAMETERS:, POSE_PARAMETERS:].sum(
            axis=0
        ) + np.diag(shared)
        self._operator = operator
        self._estimate = np.repeat(state.deviations**-2.0, (POSE_PARAMETERS - 3, 3))
        squared = (state.accelerations / _ACCELERATION_DEVIATIONS).reshape(frames, -1, 3) ** 2
        robust = 1.0 / np.sqrt(1.0 + squared.mean(axis=2))
        self.smoothness = np.repeat(robust, 3, axis=1) / _ACCELERATION_DEVIATIONS**2
        self.right = (
            precision * vectors[:, :POSE_PARAMETERS]
            + contact_vectors
            - self._estimate * state.correction
            - operator.transposed(self.smoothness * state.accelerations)
        )
        self.right_shared = (
            precision * vectors[:, POSE_PARAMETERS:].sum(axis=0) - shared * state.shared
        )
        diagonal = self._estimate + operator.diagonal(self.smoothness)
        self._inverse = np.linalg.inv(
            self._frame_matrices + diagonal[:, :, None] * np.eye(POSE_PARAMETERS)
        )
        self._inverse_shared = np.linalg.inv(self._shared_matrix)

    def apply(self, d: Array, s: Array) -> tuple[Array, Array]:
        """The system's matrix times steps."""
        product = (
            (self._frame_matrices @ d[..., None])[..., 0] + self._cross @ s + self._estimate * d
        )
        product += self._operator.transposed(self.smoothness * self._operator(d))
        return product, np.einsum("fij,fi->j", self._cross, d) + self._shared_matrix @ s

    def preconditioner_roots(self) -> tuple[Float[Array, "F 75 75"], Float[Array, "S S"]]:
        """W with W W^T about the inverse of the matrix: block diagonal by frame, and the shared
        block."""
        return np.linalg.cholesky(self._inverse), np.linalg.cholesky(self._inverse_shared)

    def determined(self) -> Float[Array, "75"]:
        """Share of each parameter that pixels rather than priors determine, summed over the
        frames."""
        return np.einsum("fij,fji->i", self._inverse, self._data)


def conjugate_gradients(system: RegularisedEquations) -> tuple[Array, Array]:
    """Steps that solve the system, by preconditioned conjugate gradients.

    The preconditioner W W^T is split, so that W^T A W y = W^T b is solved for x = W y and the norm
    of the stopping rule is the preconditioned one.
    """
    from scipy.sparse import linalg

    root, root_shared = system.preconditioner_roots()
    frames, count = system.right.shape

    def unpacked(y: Array) -> tuple[Array, Array]:
        d, s = y[: frames * count].reshape(frames, count), y[frames * count :]
        return (root @ d[..., None])[..., 0], root_shared @ s

    def packed(r: Array, rs: Array) -> Array:
        preconditioned = np.swapaxes(root, 1, 2) @ r[..., None]
        return np.concatenate([preconditioned.ravel(), root_shared.T @ rs])

    right = packed(system.right, system.right_shared)
    operator: Any = linalg.LinearOperator  # scipy's annotations know subclasses of it alone
    size = len(right)
    matrix = operator(
        (size, size), matvec=lambda y: packed(*system.apply(*unpacked(y))), dtype=float
    )
    y, _ = linalg.cg(matrix, right, rtol=_PRECISION, maxiter=_ITERATIONS)
    return unpacked(y)
