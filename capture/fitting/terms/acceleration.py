"""Bodies have mass: joints accelerate little from frame to frame."""

from __future__ import annotations

from capture.fitting.robust import pseudo_huber
from capture.fitting.state import PosedClip
from capture.fitting.term import Term
from scene.arrays import Float, Tensor

_DEVIATION_M_S2 = 9.0
"""With what the noise of a pose adds."""


class Acceleration(Term):
    """Squared accelerations of all joints, robust; none across cuts."""

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        joints = clip.posed.joint_positions
        deviation = self.seen.rate_factor * _DEVIATION_M_S2
        steps, mid_steps = self.seen.steps_s, self.seen.mid_steps_s
        return accelerations(joints, steps, mid_steps, deviation).sum() / len(joints)


def accelerations(
    joints: Float[Tensor, "F J 3"],
    steps_s: Float[Tensor, "F-1"],
    mid_steps_s: Float[Tensor, "F-2"],
    deviation_m_s2: float,
) -> Float[Tensor, "F-2 J"]:
    """Energy of the acceleration of each joint at all frames but the first and the last."""
    if len(joints) < 3:
        return joints.new_zeros(0, joints.shape[1])
    speed = (joints[1:] - joints[:-1]) / steps_s[:, None, None]
    acceleration = (speed[1:] - speed[:-1]) / mid_steps_s[:, None, None]
    return pseudo_huber((acceleration / deviation_m_s2).square().sum(-1))
