"""A field in one pose, drawn: rays in, premultiplied RGBA out. Rendering only, no gradients."""

from __future__ import annotations

import numpy as np
import torch

from renderer.field.field import PersonField
from renderer.field.marching import (
    OPAQUE,
    Samples,
    alphas,
    blending_weights,
    box_span,
    composite,
    march,
    march_all,
)
from renderer.field.posed import (
    LEAST_LIKELIHOOD,
    PosedGrid,
    Support,
    direct_canonical,
    posed_grid,
)
from renderer.field.skinning import WeightVolume
from scene.arrays import Array, Float, Tensor
from scene.camera import Camera
from scene.motion import Pose

_RAYS_AT_ONCE = 16384
_RAYS_AT_ONCE_DIRECT = 512
"""Without a posed grid every sample of a ray costs 24 look-ups, so memory holds fewer."""
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

    @torch.no_grad()
    def render(self, camera: Camera, pose: Pose) -> Float[Array, "H W 4"]:
        """Premultiplied sRGB and alpha of `pose` seen by `camera`."""
        angles = torch.from_numpy(pose.joint_angles).float()
        root = torch.from_numpy(pose.root_translation).float()
        transforms = self.field.transforms(angles, root, refine=False)
        return self.render_posed(camera, transforms, angles)

    @torch.no_grad()
    def render_posed(
        self,
        camera: Camera,
        transforms: Float[Tensor, "24 3 4"],
        joint_angles: Float[Tensor, "24 3"],
    ) -> Float[Array, "H W 4"]:
        """The same from M_i (rest -> world)."""
        picture = np.zeros((camera.height, camera.width, 4), np.float32)
        low, high = self.support.bounds(transforms)
        window = _window(camera, low.double().numpy(), high.double().numpy())
        if window is None:
            return picture
        rows, columns = window
        size = (rows.stop - rows.start, columns.stop - columns.start)
        crop = camera.cropped(columns.start, rows.start, size[1], size[0])
        directions = torch.from_numpy(crop.rays()[1]).float().view(-1, 3)
        origin = torch.from_numpy(camera.position).float()[None]
        posed = None
        if self.field.sizes.posed_grid:
            posed = posed_grid(self.field, self.volume, self.support, transforms)
        parts = [
            self._draw(origin.expand(len(part), 3), part, (low, high), posed, transforms,
                       joint_angles)
            for part in directions.split(_RAYS_AT_ONCE if posed else _RAYS_AT_ONCE_DIRECT)
        ]  # fmt: skip
        picture[rows, columns] = torch.cat(parts).view(*size, 4).numpy()
        return picture

    def _draw(
        self, origins: Tensor, directions: Tensor, box: tuple[Tensor, Tensor],
        posed: PosedGrid | None, transforms: Tensor, joint_angles: Tensor,
    ) -> Float[Tensor, "R 4"]:  # fmt: skip
        rgba = torch.zeros(len(directions), 4)
        near, far = box_span(origins, directions, *box)
        hit = torch.nonzero(far > near)[:, 0]
        if len(hit) == 0:
            return rgba
        rays = (origins[hit], directions[hit], (near[hit], far[hit]), self.field.sizes.step_m)
        samples = march_all(*rays) if posed is None else march(posed, *rays)
        rgba[hit] = self._shade(samples, posed, transforms, joint_angles)
        return rgba

    def _shade(
        self, samples: Samples, posed: PosedGrid | None, transforms: Tensor, joint_angles: Tensor
    ) -> Float[Tensor, "R 4"]:
        """Density everywhere, colour only where it is seen."""
        step = self.field.sizes.step_m
        if posed is None:
            rounds = self.field.sizes.inverse_rounds
            found, likelihood = direct_canonical(samples.points, transforms, self.volume, rounds)
        else:
            found, likelihood = posed.canonical(samples.points)
        keep = likelihood > LEAST_LIKELIHOOD
        samples, found, likelihood = samples.kept(keep), found[keep], likelihood[keep]
        canonical = self.field.canonical
        place = canonical.located(self.field.moved(found, joint_angles))
        alpha = alphas(canonical.density_at(place), likelihood, step)
        weights, before = blending_weights(alpha, samples)
        seen = (weights > _LEAST_WEIGHT) & (before > OPAQUE)
        colours, _ = canonical.at(place.kept(seen))
        return composite(weights[seen], colours, samples.kept(seen))


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
