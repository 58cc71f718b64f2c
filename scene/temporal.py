"""Accelerations of a motion, and their typical sizes in recorded motion.

Noise is independent from frame to frame, motion is not: an acceleration costs by how far it is
beyond what recorded motion shows. Capture's fit of a whole clip and the renderer's refinement of
poses both hold motions by it. Letters: F frames, h steps between neighbours, m between the middles
of steps; a = ((x_{f+1} - x_f) / h_f - (x_f - x_{f-1}) / h_{f-1}) / m_f.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scene.arrays import Array, Float
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle

ROTATION_RAD_S2 = 6.0
"""Typical angular acceleration of a joint about each axis: over ten recorded motions at 15 frames/s
the median lies between 1.4 (trunk) and 14 (right wrist), the joints' mean at 5.6."""
ROOT_M_S2 = 1.0
"""Typical acceleration of the root along each axis: medians of 0.6 sideways, 1.2 up and down."""


@dataclass(frozen=True, eq=False)
class Accelerations:
    """Second differences over a clip's own times, zero at its first and last frame."""

    before: Float[Array, "F"]
    here: Float[Array, "F"]
    after: Float[Array, "F"]
    """Coefficients of the previous, this and the next frame, 1/s^2."""

    @classmethod
    def of(cls, times_s: Float[Array, "F"]) -> Accelerations:
        """Those of a clip with frames at `times_s`."""
        before, after = np.zeros(len(times_s)), np.zeros(len(times_s))
        steps = np.diff(times_s)
        middles = 0.5 * (steps[1:] + steps[:-1])
        before[1:-1], after[1:-1] = 1.0 / (steps[:-1] * middles), 1.0 / (steps[1:] * middles)
        return cls(before, -(before + after), after)

    def __call__(self, values: Float[Array, "F N"]) -> Float[Array, "F N"]:
        """Accelerations of `values`."""
        return self._sum(values, self.before, self.here, self.after)

    def transposed(self, forces: Float[Array, "F N"]) -> Float[Array, "F N"]:
        """The transposed operator: from a gradient by accelerations to one by values."""
        before, after = np.roll(self.after, 1), np.roll(self.before, -1)
        return self._sum(forces, before, self.here, after)

    def diagonal(self, weights: Float[Array, "F N"]) -> Float[Array, "F N"]:
        """Diagonal of A^T W A, for accelerations that count `weights`."""
        before, after = np.roll(self.after, 1) ** 2, np.roll(self.before, -1) ** 2
        return self._sum(weights, before, self.here**2, after)

    def of_rotations(self, joint_angles: Float[Array, "F K 3"]) -> Float[Array, "F K 3"]:
        """Angular accelerations of the joints, each in its own frame, rad/s^2.

        To first order they change by this operator of small own-frame turns.
        """
        rotations = axis_angle_to_matrix(joint_angles)
        steps = np.zeros_like(joint_angles)
        steps[1:] = matrix_to_axis_angle(np.swapaxes(rotations[:-1], -1, -2) @ rotations[1:])
        return (
            self.after[:, None, None] * np.roll(steps, -1, axis=0)
            - self.before[:, None, None] * steps
        )

    @staticmethod
    def _sum(x: Array, before: Array, here: Array, after: Array) -> Array:
        total = here[:, None] * x
        total[1:] += before[1:, None] * x[:-1]
        total[:-1] += after[:-1, None] * x[1:]
        return total
