"""Rays through a posed body to pixels: where to sample, and how samples add up.

Letters: t distance along a ray (m), sigma density (1/m), f likelihood, T transmittance. HumanNeRF
(eq. 8-9): alpha_i = f_i (1 - exp(-sigma_i delta)), T_i = prod_{j<i} (1 - alpha_j), pixel =
sum_i T_i alpha_i c_i. Only samples in live cells are kept, packed in order a ray: `Samples`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch

from renderer.field.rendering.occupancy_grid import OccupancyGrid
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
    step: Float[Tensor, "N"]
    """Length of ray that each stands for (delta), m."""
    rays: int
    slots: int
    """Most live samples of any ray."""

    def kept(self, keep: Bool[Tensor, "N"]) -> Samples:
        """Only the samples marked; slots keep their numbers."""
        return Samples(
            self.ray[keep],
            self.slot[keep],
            self.points[keep],
            self.t[keep],
            self.step[keep],
            self.rays,
            self.slots,
        )

    def waves(self, depth: int) -> Iterator[Samples]:
        """The samples front to back, `depth` slots at a time."""
        number = self.slot // depth
        order = torch.argsort(number, stable=True)
        sizes = torch.bincount(number).tolist()
        for place, mine in enumerate(order.split(sizes)):
            wave = Samples(
                self.ray[mine],
                self.slot[mine] - place * depth,
                self.points[mine],
                self.t[mine],
                self.step[mine],
                self.rays,
                depth,
            )
            yield wave


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
    step: Float[Tensor, "R"],
    origins: Float[Tensor, "R 3"],
    directions: Float[Tensor, "R 3"],
) -> Samples:
    """The marked samples, in order; `step` is the distance between each ray's samples, m."""
    ray, place = torch.nonzero(live, as_tuple=True)
    slot, most = _slots(ray, len(live))
    distance = t[ray, place]
    points = torch.addcmul(origins[ray], distance[:, None], directions[ray])
    return Samples(ray, slot, points, distance, step[ray], len(live), most)


def _slots(ray: Int[Tensor, "N"], rays: int) -> tuple[Int[Tensor, "N"], int]:
    """Place of each sample among its ray's, and the most of any ray."""
    count = torch.bincount(ray, minlength=rays)
    slot = torch.arange(len(ray), device=ray.device) - (count.cumsum(0) - count)[ray]
    return slot, int(count.max()) if len(ray) else 0


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
        torch.cat([bundle.step for bundle in bundles]),
        rays,
        max(bundle.slots for bundle in bundles),
    )


def alphas(
    density: Float[Tensor, "N"], likelihood: Float[Tensor, "N"], step_m: Float[Tensor, "N"]
) -> Float[Tensor, "N"]:
    """alpha = f (1 - exp(-sigma delta))."""
    return likelihood * (1.0 - torch.exp(-density * step_m))


def compositing_weights(
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


def steps_of(
    span: tuple[Float[Tensor, "R"], Float[Tensor, "R"]], step_m: float, samples_a_ray: int = 0
) -> tuple[Float[Tensor, "R"], int]:
    """Distance between the samples of each ray, m, and the most samples that any ray gets.

    `samples_a_ray` divides each span evenly; nil: samples lie `step_m` apart.
    """
    near, far = span
    if samples_a_ray:
        return (far - near) / samples_a_ray, samples_a_ray
    # those of rays that meet nothing are minus infinity
    longest = max(0.0, float((far - near).max())) if len(near) else 0.0
    return torch.full_like(near, step_m), max(1, math.ceil(longest / step_m))


def march(
    cells: OccupancyGrid | None,
    origins: Float[Tensor, "R 3"],
    directions: Float[Tensor, "R 3"],
    span: tuple[Float[Tensor, "R"], Float[Tensor, "R"]],
    steps: tuple[Float[Tensor, "R"], int],
    jitter: Float[Tensor, "R"] | float = 0.5,
) -> Samples:
    """Samples within `span`, `steps` apart, that lie in live `cells` where these are given.

    `jitter` (0 .. 1) shifts each ray's samples by that share of a step: stratified in training, the
    middle in rendering.
    """
    near, far = span
    step, count = steps
    places = torch.arange(count, dtype=origins.dtype, device=origins.device)
    t = (near + jitter * step)[:, None] + step[:, None] * places
    live = t < far[:, None]
    if cells is not None:
        live &= cells.live[cells.index_along(origins, directions, t)]
    return packed(live, t, step, origins, directions)
