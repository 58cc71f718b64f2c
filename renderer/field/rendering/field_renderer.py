"""A field in one pose, drawn: rays in, premultiplied RGBA out. Rendering only, no gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from renderer.devices import on_device, on_host
from renderer.field.field import PersonField
from renderer.field.rendering.gpu import FusedDrawing, draws
from renderer.field.rendering.occupancy_grid import OccupancyGrid
from renderer.field.rendering.ray_marching import (
    OPAQUE,
    Samples,
    alphas,
    box_span,
    composite,
    compositing_weights,
    march,
    steps_of,
)
from renderer.field.skinning.inverse_skinning import WeightVolume
from renderer.field.skinning.posed_body import (
    LEAST_LIKELIHOOD,
    Support,
    direct_canonical,
    occupied_before_residual,
    occupied_cells,
    reached_cells,
)
from renderer.field.skinning.posed_grid import PosedGrid, posed_grid
from scene.arrays import Array, Float, Tensor
from scene.camera import Camera
from scene.motion import Pose

_RAYS_AT_ONCE = 16384
_RAYS_AT_ONCE_IN_WAVES = 8192
_RAYS_AT_ONCE_CULLED = 4096
_RAYS_AT_ONCE_DIRECT = 512
"""Where every sample of a ray costs 24 look-ups, memory holds fewer."""
_TIMES_ON_A_GPU = 64
"""A GPU waits for its next task when it gets no more rays at once than a CPU's cache likes."""
_WAVE = 8
"""Samples of a ray that are asked before looking whether the ray has become opaque."""
_LEAST_WEIGHT = 1e-3
"""Blending weight below which a sample's colour can't be seen."""


class FieldRenderer:
    """Draws a field whose weights stay as they are: the weight volume is made once."""

    def __init__(
        self, field: PersonField, prepared: tuple[WeightVolume, Support] | None = None
    ) -> None:
        """`prepared`: the field's weight volume and support where the caller has them already."""
        self.field = field
        if prepared is None:
            with torch.no_grad():
                volume = field.weight_volume()
                prepared = volume, Support.of(volume)
        self.volume, self.support = prepared
        self.device = self.volume.low.device
        self._fused = None
        if draws(field, self.device):
            self._fused = FusedDrawing(field, self.volume, self.support)

    @torch.no_grad()
    def render(self, camera: Camera, pose: Pose) -> Float[Array, "H W 4"]:
        """Premultiplied sRGB and alpha of `pose` seen by `camera`."""
        angles = on_device(pose.joint_angles, self.device, torch.float32)
        root = on_device(pose.root_translation, self.device, torch.float32)
        transforms = self.field.transforms(angles, root, refine=False)
        return self.render_posed(camera, transforms, angles)

    @torch.no_grad()
    def render_posed(
        self,
        camera: Camera,
        transforms: Float[Tensor, "K 3 4"],
        joint_angles: Float[Tensor, "K 3"],
    ) -> Float[Array, "H W 4"]:
        """The same from M_i (rest -> world)."""
        picture = np.zeros((camera.height, camera.width, 4), np.float32)
        low, high = self.support.bounds(transforms)
        window = _window(camera, on_host(low.double()), on_host(high.double()))
        if window is None:
            return picture
        rows, columns = window
        size = (rows.stop - rows.start, columns.stop - columns.start)
        crop = camera.cropped(columns.start, rows.start, size[1], size[0])
        before = None
        if self.field.sizes.occupancy:
            before = occupied_before_residual(self.field, joint_angles)
        if self._fused is not None and before is not None and camera.distortion is None:
            box = low, high
            picture[rows, columns] = self._fused.render(crop, box, transforms, joint_angles, before)
            return picture
        directions = on_device(crop.rays()[1], self.device, torch.float32).view(-1, 3)
        origin = on_device(camera.position, self.device, torch.float32)[None]
        cells = self._cells(transforms, joint_angles, before)
        draw = _Draw(self, (low, high), cells, before, transforms, joint_angles)
        parts = [
            draw.rays(origin.expand(len(part), 3), part)
            for part in directions.split(self._rays_at_once(cells))
        ]
        picture[rows, columns] = on_host(torch.cat(parts).view(*size, 4))
        return picture

    def _cells(
        self,
        transforms: Float[Tensor, "K 3 4"],
        joint_angles: Float[Tensor, "K 3"],
        before: OccupancyGrid | None,
    ) -> OccupancyGrid | None:
        """What is known of this pose before any sample is asked."""
        field, volume, support = self.field, self.volume, self.support
        if field.sizes.posed_grid:
            return posed_grid(field, volume, support, transforms)
        if field.sizes.occupancy:
            return occupied_cells(field, volume, support, transforms, joint_angles, before)
        return reached_cells(support, transforms) if field.sizes.cull else None

    def _rays_at_once(self, cells: OccupancyGrid | None) -> int:
        """As many as memory holds samples of."""
        times = _TIMES_ON_A_GPU if self.device.type == "cuda" and cells is not None else 1
        if isinstance(cells, PosedGrid):
            return times * _RAYS_AT_ONCE
        if self.in_waves:
            return times * _RAYS_AT_ONCE_IN_WAVES
        return _RAYS_AT_ONCE_DIRECT if cells is None else times * _RAYS_AT_ONCE_CULLED

    @property
    def in_waves(self) -> bool:
        """Whether samples are asked front to back. A grid tells density so cheaply that all of a
        ray is asked at once."""
        return self.field.sizes.early_stop and not self.field.canonical.has_grid


@dataclass(frozen=True, eq=False)
class _Draw:
    """One pose being drawn."""

    renderer: FieldRenderer
    box: tuple[Float[Tensor, "3"], Float[Tensor, "3"]]
    cells: OccupancyGrid | None
    """Where samples of this pose can hold anything; None: anywhere."""
    before: OccupancyGrid | None
    """The same of canonical points before residual motion."""
    transforms: Float[Tensor, "K 3 4"]
    joint_angles: Float[Tensor, "K 3"]

    def rays(
        self, origins: Float[Tensor, "R 3"], directions: Float[Tensor, "R 3"]
    ) -> Float[Tensor, "R 4"]:
        """Premultiplied RGBA of rays."""
        sizes = self.renderer.field.sizes
        rgba = torch.zeros(len(directions), 4, device=directions.device)
        near, far = box_span(origins, directions, *self.box)
        hit = torch.nonzero(far > near)[:, 0]
        if len(hit) == 0:
            return rgba
        span = near[hit], far[hit]
        steps = steps_of(span, sizes.step_m, sizes.samples_a_ray)
        samples = march(self.cells, origins[hit], directions[hit], span, steps)
        in_waves = self.renderer.in_waves
        rgba[hit] = self._in_waves(samples) if in_waves else self._shaded(samples)
        return rgba

    def _in_waves(self, samples: Samples) -> Float[Tensor, "R 4"]:
        """Front to back, each ray as far as it can be seen into."""
        rgba = torch.zeros(samples.rays, 4, device=samples.t.device)
        for wave in samples.waves(_WAVE):
            through = 1.0 - rgba[:, 3:]
            visible = wave.kept(through[wave.ray, 0] > OPAQUE)
            if len(visible.ray):
                rgba = rgba + through * self._shaded(visible)
        return rgba

    def _shaded(self, samples: Samples) -> Float[Tensor, "R 4"]:
        """RGBA of the samples, those left out that the field's speed-ups need not ask."""
        field = self.renderer.field
        found, likelihood = self._canonical(samples)
        if self.cells is not None:
            keep = likelihood > LEAST_LIKELIHOOD
            if self.before is not None:
                keep &= self.before.holds(found)
            samples, found, likelihood = samples.kept(keep), found[keep], likelihood[keep]
        found = field.moved(found, self.joint_angles)
        occupied = field.occupied_at(found)
        if occupied is not None and field.sizes.occupancy:
            samples, found = samples.kept(occupied), found[occupied]
            likelihood, occupied = likelihood[occupied], None
        canonical = field.canonical
        place = canonical.located(found)
        if canonical.has_grid:
            density = canonical.density_at(place)
            alpha = alphas(density, likelihood, samples.step)
            weights, before = compositing_weights(alpha, samples)
            seen = weights > _LEAST_WEIGHT
            if field.sizes.early_stop:
                seen &= before > OPAQUE
            colours, _ = canonical.at(place.kept(seen))
            return composite(weights[seen], colours, samples.kept(seen))
        colours, density = canonical.at(place)
        if occupied is not None:
            density = density * occupied
        weights, _ = compositing_weights(alphas(density, likelihood, samples.step), samples)
        return composite(weights, colours, samples)

    def _canonical(self, samples: Samples) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N"]]:
        if isinstance(self.cells, PosedGrid):
            return self.cells.canonical(samples.points)
        renderer, rounds = self.renderer, self.renderer.field.sizes.inverse_rounds
        support = None if self.cells is None else renderer.support
        return direct_canonical(samples.points, self.transforms, renderer.volume, rounds, support)


def _window(camera: Camera, low: Array, high: Array) -> tuple[slice, slice] | None:
    """Rows and columns that the box can cover; all where it reaches behind the camera; None where
    it is out of sight."""
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1)
    pixels, depth = camera.project(corners.reshape(-1, 3))
    if (depth <= 0.0).all():
        return None
    if (depth <= 0.05).any() or camera.distortion is not None:
        return slice(0, camera.height), slice(0, camera.width)
    start = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
    stop = np.minimum(np.ceil(pixels.max(axis=0)).astype(int), [camera.width, camera.height])
    if (stop <= start).any():
        return None
    return slice(int(start[1]), int(stop[1])), slice(int(start[0]), int(stop[0]))
