"""Inverse skinning as the paper writes it, one point and one joint at a time: the twin to trust.

Twin of `renderer.field.skinning.inverse_skinning`. Slow on purpose.
"""

from __future__ import annotations

import torch

from scene.arrays import Float, Tensor


def weight_at(
    volume: Float[Tensor, "D H W"],
    point: Float[Tensor, "3"],
    low: Float[Tensor, "3"],
    high: Float[Tensor, "3"],
) -> Tensor:
    """One channel, interpolated at one point; nil outside the box."""
    if bool((point < low).any() or (point > high).any()):
        return volume.new_zeros(())
    size = torch.tensor([volume.shape[2], volume.shape[1], volume.shape[0]], dtype=point.dtype) - 1
    at = (point - low) / (high - low) * size
    total = volume.new_zeros(())
    for corner in range(8):
        index, weight = [], volume.new_ones(())
        for axis in range(3):
            start = min(int(at[axis].detach()), int(size[axis]) - 1)
            upper = (corner >> axis) & 1
            share = at[axis] - start
            weight = weight * (share if upper else 1.0 - share)
            index.append(start + upper)
        total = total + weight * volume[index[2], index[1], index[0]]
    return total


def inverse_skinning(
    points: Float[Tensor, "N 3"],
    transforms: Float[Tensor, "24 3 4"],
    volume: Float[Tensor, "25 D H W"],
    low: Float[Tensor, "3"],
    high: Float[Tensor, "3"],
) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N"]]:
    """x_skel = sum_i w_i(x_i) x_i / max(sum_i w_i(x_i), 1e-4) and f = min(sum_i w_i(x_i), 1)."""
    canonical, likelihood = [], []
    for point in points:
        weighted, total = points.new_zeros(3), points.new_zeros(())
        for joint, transform in enumerate(transforms):
            inverse = torch.linalg.inv(transform[:, :3])
            at_rest = inverse @ (point - transform[:, 3])
            weight = weight_at(volume[joint], at_rest, low, high)
            weighted, total = weighted + weight * at_rest, total + weight
        canonical.append(weighted / total.clamp(min=1e-4))
        likelihood.append(total.clamp(max=1.0))
    return torch.stack(canonical), torch.stack(likelihood)
