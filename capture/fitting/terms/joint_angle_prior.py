"""The prior of everyday joint angles, and the ends of hinges."""

from __future__ import annotations

from capture.body.pose_prior import pose_prior
from capture.fitting.observations import Observations
from capture.fitting.state import FitBody, PosedClip
from capture.fitting.term import Term
from scene.arrays import Float, Tensor


class JointAnglePrior(Term):
    """`capture.body.pose_prior`, with joints held at its mean that nothing shows for long."""

    weight = 0.1

    def __init__(self, body: FitBody, seen: Observations) -> None:
        super().__init__(body, seen)
        self._prior = pose_prior()

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        return self._prior.energy(clip.state.joint_angles, self.seen.hidden).mean()
