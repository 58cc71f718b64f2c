"""The reprojection error: the body's landmarks lie where they were seen in the picture."""

from __future__ import annotations

from capture.fitting.robust import geman_mcclure, pseudo_huber
from capture.fitting.state import PosedClip
from capture.fitting.term import Term
from scene.arrays import Float, Tensor

DEVIATION = 0.016
"""Of a landmark, in heights of the person."""
_OUTLIER = 3.0
"""Deviations from which a landmark has no say, once the silhouette has one."""


class ReprojectionError(Term):
    """Squared distance in the picture of each landmark from its projection, robust."""

    _has_pictures = False

    def prepare(self, clip: PosedClip, *, coarse: bool) -> None:
        self._has_pictures = True

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        error = clip.reprojection_error_px / (DEVIATION * self.seen.person_px)[:, None, None]
        squared = error.square().sum(-1)
        loss = geman_mcclure(squared, _OUTLIER) if self._has_pictures else pseudo_huber(squared)
        frames = (loss * self.seen.landmark_weights).sum(1)
        return (clip.state.frame_confidence * frames).mean()
