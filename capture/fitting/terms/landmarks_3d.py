"""The estimator's own 3D landmarks, whose size is its guess: one scale a clip."""

from __future__ import annotations

import torch

from capture.body.landmark_names import FACE_LANDMARKS, LANDMARK_COUNT
from capture.fitting.robust import pseudo_huber
from capture.fitting.state import PosedClip
from capture.fitting.term import Term
from scene.arrays import Float, Tensor

DEVIATION_M = 0.07
FACE_DEPTH_WEIGHT = 0.3
"""Of the face's landmarks, beside the others': the estimator pulls heads towards the camera."""


class Landmarks3D(Term):
    """Squared distance between both sets of landmarks about their weighted means, robust."""

    weight = 0.05

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        depth_weights = torch.ones(LANDMARK_COUNT)
        depth_weights[:FACE_LANDMARKS] = FACE_DEPTH_WEIGHT
        weight = (self.seen.landmark_weights * depth_weights)[..., None]
        total = weight.sum(1, keepdim=True).clamp_min(1e-6)
        posed, observed = clip.landmarks, self.seen.landmarks_m
        posed = posed - (posed * weight).sum(1, keepdim=True) / total
        observed = observed - (observed * weight).sum(1, keepdim=True) / total
        error = (posed - observed * torch.exp(clip.state.log_landmark_scale)) / DEVIATION_M
        frames = (pseudo_huber(error.square().sum(-1)) * weight[..., 0]).sum(1)
        return (clip.state.frame_confidence * frames).mean()
