"""Priors of what is constant over a clip: shape, camera, clothing, landmarks, lifter bias."""

from __future__ import annotations

import torch

from capture.fitting.state import PosedClip
from capture.fitting.term import Term
from scene.arrays import Float, Tensor

_FOCAL_DEVIATION = 0.12
"""Of the logarithm of the focal length."""
_SHAPE_DEVIATION = (0.06, 0.2, 0.2, 0.2, 0.2)
"""Of height (in 1.03 m), weight, gender, muscle, proportions."""
_SHAPE_WEIGHT = 0.5
_FARTHEST_SHAPE, _SHAPE_WALL = 0.5, 0.05
"""Soft limit of the shape numbers, which loose clothes would exceed."""
_LIFTER_BIAS_RAD, _LIFTER_BIAS_WEIGHT = 0.25, 0.05
"""Deviation of a joint's constant rotation relative to the lifter's poses."""
_CLOTHING_DEVIATION_M = 0.01
_OFFSET_DEVIATION_M, _OFFSET_WEIGHT = 0.01, 0.1


class ClipPriors(Term):
    """Gaussian priors; counted once a clip, beside the frames' mean energies."""

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        state = clip.state
        shape = (state.shape / torch.tensor(_SHAPE_DEVIATION)).square().sum()
        beyond = torch.relu(state.shape.abs() - _FARTHEST_SHAPE) / _SHAPE_WALL
        return (
            _LIFTER_BIAS_WEIGHT * (state.lifter_bias / _LIFTER_BIAS_RAD).square().sum()
            + _SHAPE_WEIGHT * shape
            + beyond.square().sum()
            + 0.5 * (state.clothing_m / _CLOTHING_DEVIATION_M) ** 2
            + _OFFSET_WEIGHT * (state.landmark_offsets / _OFFSET_DEVIATION_M).square().sum()
            + 0.5 * (state.log_focal / _FOCAL_DEVIATION).square()
        )
