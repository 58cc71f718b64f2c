"""Head and palms, as the landmarkers of faces and hands see them."""

from __future__ import annotations

import numpy as np
import torch

from capture.detection.rigid_parts import PART_JOINTS, PARTS, rest_points
from capture.fitting.observations import Observations
from capture.fitting.robust import geman_mcclure
from capture.fitting.state import FitBody, PosedClip
from capture.fitting.term import Term
from scene.arrays import Float, Tensor

DEVIATION = 0.006
"""Of a part's middle in the picture, in heights of the person."""
DEVIATION_RAD = (0.05, 0.25, 0.25)
"""Of the head's rotation, which scatters by 1 to 2.5 degrees, and of the palms'."""
_JOINTS = list(PART_JOINTS)
_OUTLIER = 4.0
"""Deviations from which a part has no say: it may be another hand, or the wrong way round."""


class PartPoses(Term):
    """Squared distance of each part's middle in the picture and of its rotation, robust.

    The body's own landmarks have two or three points a hand, and the depth of a face from a guess;
    wrists and the head's pitch are hardly known by them.
    """

    def __init__(self, body: FitBody, seen: Observations) -> None:
        super().__init__(body, seen)
        middles = np.array([rest_points(part).mean(axis=0) for part in PARTS])
        self._middles = torch.tensor(middles, dtype=torch.get_default_dtype())
        self._spread = torch.tensor(DEVIATION_RAD)

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        parts = self.seen.parts
        if parts is None:
            return torch.zeros(())
        rotations = clip.posed.global_rotations[:, _JOINTS]
        at = clip.posed.joint_positions[:, _JOINTS] + (
            rotations @ self._middles[..., None]
        ).squeeze(-1)
        error = (clip.project(at) - parts.middles_px) / (DEVIATION * self.seen.person_px)
        # |R - S|^2 = 8 sin^2(angle / 2), twice the squared angle where that is small
        angle = 0.5 * (rotations - parts.rotations).square().sum((-1, -2))
        moved = geman_mcclure(error.square().sum(-1), _OUTLIER)
        turned = geman_mcclure(angle / self._spread.square(), _OUTLIER)
        return (moved * parts.found + turned * parts.turned).sum(1).mean()
