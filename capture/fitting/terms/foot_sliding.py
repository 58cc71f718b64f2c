"""Feet that stand do not slide."""

from __future__ import annotations

from capture.fitting.robust import geman_mcclure
from capture.fitting.state import PosedClip
from capture.fitting.term import Term
from scene.arrays import Float, Tensor
from scene.skeleton import FOOT_JOINTS

_DEVIATION_M_S = 0.2
"""Of feet that stand, with what the noise of a pose adds."""
_SWINGS = 3.0
"""Deviations of a foot's speed from which it is taken for swinging."""


class FootSliding(Term):
    """Squared speeds of the feet: slow ones are held where they stand, fast ones swing freely.

    So they neither slide nor let the body drift in depth.
    """

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        feet = clip.posed.joint_positions[:, list(FOOT_JOINTS)]
        speed = (feet[1:] - feet[:-1]) / self.seen.steps_s[:, None, None]
        deviation = self.seen.rate_factor * _DEVIATION_M_S
        return geman_mcclure((speed / deviation).square().sum(-1), _SWINGS).sum() / len(feet)
