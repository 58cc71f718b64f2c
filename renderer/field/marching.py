"""Rays through a posed body to pixels: where to sample, and how samples add up.

Letters: t distance along a ray (m), sigma density (1/m), f likelihood, T transmittance. HumanNeRF
(eq. 8-9): alpha_i = f_i (1 - exp(-sigma_i delta)), T_i = prod_{j<i} (1 - alpha_j), pixel =
sum_i T_i alpha_i c_i. Only samples in live cells are kept, packed in order a ray: `Samples`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from renderer.field.posed import PosedGrid
from scene.arrays import Bool, Float, Int, Tensor

OPAQUE = 1e-3
"""Transmittance below which the rest of a ray can't be seen (a quarter of a byte's step)."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Live samples of a bundle of rays."""

    ray: Int[Tensor, "N"]
    """Which ray each belongs to; ascending, front to back within a ray."""
    slot: Int[Tensor, "N"]
    """Place among the ray's live samples."""
    points: Float[Tensor, "N 3"]
    t: Float[Tensor, "N"]
    """Distance along the ray, m."""
    rays: int
    slots: int
    """Most live samples of any ray."""

    def kept(self, keep: Bool[Tensor, "N"]) -> Samples:
        """Only the samples marked; slots keep their numbers."""
        return Samples(
            self.ray[keep], self.slot[keep], self.points[keep], self.t[keep], self.rays, self.slots
        )


def box_span(
    origins: Float[Tensor, "R 3"],
    directions: Float[Tensor, "R 3"],
    low: Float[Tensor, "3"],
    high: Float[Tensor, "3"],
) -> tuple[Float[Tensor, "R"], Float[Tensor, "R"]]:
    """Where rays enter and leave a box, m; entry >= exit where they miss it."""
    safe = torch.where(directions.abs() < 1e-9, torch.full_like(directions, 1e-9), directions)
    one, other = (low - origins) / safe, (high - origins) / safe
    enter = torch.minimum(one, other).amax(dim=1).clamp(min=0.0)
    return enter, torch.maximum(one, other).amin(dim=1)


def packed(
    live: Bool[Tensor, "R S"],
    t: Float[Tensor, "R S"],
    origins: Float[Tensor, "R 3"],
    directions: Float[Tensor, "R 3"],
) -> Samples:
    """The marked samples, in order."""
    ray, place = torch.nonzero(live, as_tuple=True)
    count = torch.bincount(ray, minlength=len(live))
    slot = torch.arange(len(ray)) - (count.cumsum(0) - count)[ray]
    most = int(count.max()) if len(ray) else 0
    distance = t[ray, place]
    points = torch.addcmul(origins[ray], distance[:, None], directions[ray])
    return Samples(ray, slot, points, distance, len(live), most)


def joined(bundles: list[Samples]) -> Samples:
    """Several bundles of rays as one, in their order."""
    first, rays = [], 0
    for bundle in bundles:
        first.append(bundle.ray + rays)
        rays += bundle.rays
    return Samples(
        torch.cat(first),
        torch.cat([bundle.slot for bundle in bundles]),
        torch.cat([bundle.points for bundle in bundles]),
        torch.cat([bundle.t for bundle in bundles]),
        rays,
        max(bundle.slots for bundle in bundles),
    )


def alphas(
    density: Float[Tensor, "N"], likelihood: Float[Tensor, "N"], step_m: float
) -> Float[Tensor, "N"]:
    """alpha = f (1 - exp(-sigma delta))."""
    return likelihood * (1.0 - torch.exp(-density * step_m))


def blending_weights(
    alpha: Float[Tensor, "N"], samples: Samples
) -> tuple[Float[Tensor, "N"], Float[Tensor, "N"]]:
    """T_i alpha_i and T_i of every sample."""
    if samples.slots == 0:
        return alpha, alpha
    flat = samples.ray * samples.slots + samples.slot
    dense = alpha.new_zeros(samples.rays * samples.slots).index_put((flat,), alpha)
    through = torch.cumprod(1.0 - dense.view(samples.rays, samples.slots) + 1e-7, dim=1)
    before = torch.cat([torch.ones_like(through[:, :1]), through[:, :-1]], dim=1)
    transmittance = before.reshape(-1)[flat]
    return transmittance * alpha, transmittance


def composite(
    weights: Float[Tensor, "N"], colours: Float[Tensor, "N 3"], samples: Samples
) -> Float[Tensor, "R 4"]:
    """Premultiplied RGBA of every ray."""
    rgba = torch.cat([weights[:, None] * colours, weights[:, None]], dim=1)
    return rgba.new_zeros(samples.rays, 4).index_add(0, samples.ray, rgba)


def march(
    grid: PosedGrid,
    origins: Float[Tensor, "R 3"],
    directions: Float[Tensor, "R 3"],
    span: tuple[Float[Tensor, "R"], Float[Tensor, "R"]],
    step_m: float,
    jitter: Float[Tensor, "R"] | float = 0.5,
) -> Samples:
    """Samples `step_m` apart within `span` that lie in live cells of `grid`.

    `jitter` (0 .. 1) shifts each ray's samples by that share of a step: stratified in training, the
    middle in rendering.
    """
    near, far = span
    longest = float((far - near).max()) if len(near) else 0.0
    count = max(1, math.ceil(longest / step_m))
    first = near + jitter * step_m
    t = first[:, None] + step_m * torch.arange(count, dtype=origins.dtype)
    scale = (grid.side - 1) / (grid.high - grid.low)
    start, slope = (origins - grid.low) * scale, directions * scale
    index = torch.zeros(t.shape, dtype=torch.int32)
    for axis, stride in ((2, grid.side * grid.side), (1, grid.side), (0, 1)):
        cell = torch.addcmul(start[:, axis : axis + 1], t, slope[:, axis : axis + 1])
        index += stride * cell.to(torch.int32).clamp_(0, grid.side - 2)
    live = grid.live[index] & (t < far[:, None])
    return packed(live, t, origins, directions)


def march_all(
    origins: Float[Tensor, "R 3"],
    directions: Float[Tensor, "R 3"],
    span: tuple[Float[Tensor, "R"], Float[Tensor, "R"]],
    step_m: float,
    jitter: Float[Tensor, "R"] | float = 0.5,
) -> Samples:
    """The same without a grid: every sample within `span`."""
    near, far = span
    longest = float((far - near).max()) if len(near) else 0.0
    count = max(1, math.ceil(longest / step_m))
    t = (near + jitter * step_m)[:, None] + step_m * torch.arange(count, dtype=origins.dtype)
    return packed(t < far[:, None], t, origins, directions)
