"""Head and palms, as the landmarkers of faces and hands see them."""

from __future__ import annotations

import numpy as np
import torch

from capture.detection.rigid_parts import PART_JOINTS, PARTS, rest_points
from capture.fitting.kinematics import project
from capture.fitting.observations import Observations, PartObservations
from capture.fitting.robust import geman_mcclure
from capture.fitting.state import FitBody, PosedClip
from capture.fitting.term import Term
from scene.arrays import Float, Tensor

DEVIATION = 0.006
"""Of a part's middle in the picture, in heights of the person."""
DEVIATION_RAD = (0.05, 0.25, 0.25)
"""Of the head's rotation, which scatters by 1 to 2.5 degrees, and of the palms'."""
PALM_WEIGHT = 8.0
"""Of the mean over a palm's points. Without it, the palms of fast hands point 30 degrees beside
those in the picture."""
_JOINTS = list(PART_JOINTS)
_OUTLIER = 4.0
"""Deviations from which a part has no say: it may be another hand, or the wrong way round."""
_HAND_SIZES = 0.7, 1.3
"""The smallest and largest hands, as shares of the mean body's."""


class PartPoses(Term):
    """Squared distance of each part's middle in the picture and of its rotation, and of a palm's
    wrist and knuckles about their middle, robust.

    The body's own landmarks have two or three points a hand, and the depth of a face from a guess;
    wrists and the head's pitch are hardly known by them. How a palm is turned in depth is as much
    a guess, but which way it points in the picture is not. That moves nothing but rotations: hands
    larger than the mean body's would else make their owner larger.
    """

    def __init__(self, body: FitBody, seen: Observations) -> None:
        super().__init__(body, seen)
        middles = np.array([rest_points(part).mean(axis=0) for part in PARTS])
        self._middles = torch.tensor(middles, dtype=torch.get_default_dtype())
        palms = np.array([rest_points(part) for part in PARTS[1:]])
        palms -= palms.mean(axis=1, keepdims=True)
        self._palms = torch.tensor(palms, dtype=torch.get_default_dtype())
        self._spread = torch.tensor(DEVIATION_RAD)

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        parts = self.seen.parts
        if parts is None:
            return torch.zeros(())
        rotations = clip.posed.global_rotations[:, _JOINTS]
        at = clip.posed.joint_positions[:, _JOINTS] + (
            rotations @ self._middles[..., None]
        ).squeeze(-1)
        deviation_px = DEVIATION * self.seen.person_px
        error = (clip.project(at) - parts.middles_px) / deviation_px[:, None, None]
        # |R - S|^2 = 8 sin^2(angle / 2), twice the squared angle where that is small
        angle = 0.5 * (rotations - parts.rotations).square().sum((-1, -2))
        moved = geman_mcclure(error.square().sum(-1), _OUTLIER)
        turned = geman_mcclure(angle / self._spread.square(), _OUTLIER)
        found = (moved * parts.found + turned * parts.turned).sum(1)
        return (found + self._palms_energy(clip, parts, rotations[:, 1:], at[:, 1:])).mean()

    def _palms_energy(
        self,
        clip: PosedClip,
        parts: PartObservations,
        rotations: Float[Tensor, "F 2 3 3"],
        middles: Float[Tensor, "F 2 3"],
    ) -> Float[Tensor, "F"]:
        beside = torch.einsum("fkxy,kpy->fkpx", rotations, self._palms)
        seen = parts.palms_px - parts.palms_px.mean(-2, keepdim=True)

        def shown(size: float | Tensor) -> Float[Tensor, "F 2 5 2"]:
            points = middles.detach()[:, :, None] + size * beside
            pixels = project(points, clip.focal_px.detach(), self.seen.centre)
            return pixels - pixels.mean(-2, keepdim=True)

        with torch.no_grad():
            found = parts.palms_found[..., None, None]
            usual = (shown(1.0).square() * found).sum().clamp_min(1e-6)
            size = ((seen.square() * found).sum() / usual).sqrt().clamp(*_HAND_SIZES)
        error = (shown(size) - seen) / (DEVIATION * self.seen.person_px)[:, None, None, None]
        energy = geman_mcclure(error.square().sum(-1), _OUTLIER).mean(-1)
        return PALM_WEIGHT * (energy * parts.palms_found).sum(1)
