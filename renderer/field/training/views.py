"""Training frames as rays: cropped to the body, with what one pose needs cached beside them."""

from __future__ import annotations

import numpy as np
import torch

from renderer.devices import on_device
from renderer.errors import TrainingError
from renderer.evaluation.metrics import over_black
from renderer.field.field import PersonField
from renderer.field.rendering.occupancy_grid import OccupancyGrid
from renderer.field.rendering.ray_marching import box_span, march, steps_of
from renderer.field.skinning.inverse_skinning import WeightVolume
from renderer.field.skinning.posed_body import Support, reached_cells
from renderer.field.skinning.posed_grid import posed_grid
from scene.arrays import Array, Float, Int, Tensor
from scene.sequence import FrameSource, body_crop

_CROP_MARGIN = 0.12
"""Share of the body's box kept round it: room where density that strays is still punished."""
_STALE_M = 0.01
"""Movement of any joint after which a cached grid is made anew."""


class TrainingView:
    """One frame: its pixels as rays and colours, and its pose's grid once it is asked for."""

    def __init__(
        self,
        rgba: Float[Array, "H W 4"],
        directions: Float[Array, "H W 3"],
        origin: Float[Array, "3"],
        joint_angles: Float[Array, "K 3"],
        root_translation: Float[Array, "3"],
        device: torch.device,
    ) -> None:
        self.shape = rgba.shape[:2]
        in_bytes = (rgba.reshape(-1, 4) * 255.0 + 0.5).astype(np.uint8)
        self._rgba = on_device(in_bytes, device)
        self._directions = on_device(directions.reshape(-1, 3), device, torch.float32)
        self._origin = on_device(origin, device, torch.float32)[None]
        self.joint_angles = on_device(joint_angles, device, torch.float32)
        self.root_translation = on_device(root_translation, device, torch.float32)
        self.cells: OccupancyGrid | None = None
        """Where samples of this pose can hold anything: its posed grid or its culled cells."""
        self._made_for: Tensor | None = None
        self._on_body = self._beside = torch.arange(len(self._rgba), device=device)
        self._near = self._far = self._furthest = torch.zeros(len(self._rgba), device=device)

    @property
    def shows_person(self) -> bool:
        """Whether the mask has anything in it."""
        return bool(self._rgba[:, 3].any())

    def prepare(
        self,
        field: PersonField,
        volume: WeightVolume,
        support: Support,
        transforms: Float[Tensor, "K 3 4"],
    ) -> None:
        """Find where this frame's rays meet the body, unless that is known for (nearly) this
        pose."""
        if self._made_for is not None:
            moved = (transforms - self._made_for)[..., 3].abs().max()
            turned = (transforms - self._made_for)[..., :3].abs().max()
            if float(torch.maximum(moved, turned)) < _STALE_M:
                return
        self._made_for = transforms
        origins = self._origin.expand(len(self._directions), 3)
        near, far = box_span(origins, self._directions, *support.bounds(transforms))
        sizes = field.sizes
        self.cells = None
        if sizes.posed_grid:
            self.cells = posed_grid(field, volume, support, transforms)
        elif sizes.cull:
            self.cells = reached_cells(support, transforms)
        if self.cells is not None:
            near, far = self._live_span(self.cells, near, far, sizes.step_m)
        self._near, self._far, self._furthest = near, far, far.clone()
        hit = far > near
        self._on_body = torch.nonzero(hit & (self._rgba[:, 3] > 0))[:, 0]
        self._beside = torch.nonzero(hit & (self._rgba[:, 3] == 0))[:, 0]

    def _live_span(
        self, cells: OccupancyGrid, near: Tensor, far: Tensor, step_m: float
    ) -> tuple[Float[Tensor, "P"], Float[Tensor, "P"]]:
        """First and last live place of every ray, wider by the search's own step; empty where the
        ray meets nothing."""
        hit = torch.nonzero(far > near)[:, 0]
        origins = self._origin.expand(len(hit), 3)
        span = near[hit], far[hit]
        samples = march(cells, origins, self._directions[hit], span, steps_of(span, 2.0 * step_m))
        along = ((samples.points - self._origin) * self._directions[hit][samples.ray]).sum(dim=1)
        nowhere = torch.full((len(hit),), torch.inf, device=near.device)
        first = nowhere.scatter_reduce(0, samples.ray, along, "amin")
        last = (-nowhere).scatter_reduce(0, samples.ray, along, "amax")
        start, stop = torch.zeros_like(near), torch.full_like(far, -1.0)
        start[hit], stop[hit] = first - 2.0 * step_m, last + 2.0 * step_m
        return start, stop

    def pick(self, count: int, beside: float, chance: torch.Generator) -> Int[Tensor, "R"]:
        """Pixels whose rays meet the body's shell: a share `beside` of them off the mask, where
        there is only emptiness to learn."""
        off = round(count * beside) if len(self._on_body) else count
        parts = [
            group[torch.randint(len(group), (number,), generator=chance).to(group.device)]
            for group, number in ((self._on_body, count - off), (self._beside, off))
            if len(group) and number
        ]
        return torch.cat(parts) if parts else self._on_body

    def pick_patches(
        self, count: int, side: int, on_body: float, chance: torch.Generator
    ) -> Int[Tensor, "R"]:
        """Pixels of `count` square patches, row by row; a share `on_body` of them is centred on
        the body, the others anywhere. All lie within the crop."""
        height, width = self.shape
        device = self._on_body.device
        centre = torch.randint(height * width, (count,), generator=chance).to(device)
        if len(self._on_body):
            places = torch.randint(len(self._on_body), (count,), generator=chance).to(device)
            hit = torch.rand(count, generator=chance).to(device) < on_body
            centre = torch.where(hit, self._on_body[places], centre)
        top = (centre // width - side // 2).clamp(0, height - side)
        left = (centre % width - side // 2).clamp(0, width - side)
        span = torch.arange(side, device=device)
        rows, columns = top[:, None] + span, left[:, None] + span
        return (rows[:, :, None] * width + columns[:, None, :]).reshape(-1)

    def rays(
        self, pixels: Int[Tensor, "R"]
    ) -> tuple[Float[Tensor, "R 3"], Float[Tensor, "R 3"], tuple[Tensor, Tensor]]:
        """Origins, directions and (near, far) of pixels."""
        origins = self._origin.expand(len(pixels), 3)
        return origins, self._directions[pixels], (self._near[pixels], self._far[pixels])

    def shorten(self, pixels: Int[Tensor, "R"], depth_m: Float[Tensor, "R"]) -> None:
        """End rays at `depth_m` from now on: everything behind is hidden."""
        self._far[pixels] = torch.minimum(depth_m, self._furthest[pixels])

    def truth(self, pixels: Int[Tensor, "R"]) -> Float[Tensor, "R 4"]:
        """Premultiplied RGBA of pixels."""
        return self._rgba[pixels].float() / 255.0


def read_views(
    source: FrameSource, device: torch.device, *, least_px: int = 0, most_px: int | None = None
) -> list[TrainingView]:
    """All frames of `source` on `device`, cropped to the body, to `least_px` a side or more, then
    shrunk to `most_px`.

    Raises TrainingError for pictures smaller than `least_px`.
    """
    return [_read_view(source, index, device, least_px, most_px) for index in range(len(source))]


def _read_view(
    source: FrameSource, index: int, device: torch.device, least_px: int, most_px: int | None
) -> TrainingView:
    image, mask, camera = source.image(index), source.mask(index), source.camera(index)
    if min(mask.shape) < least_px:
        raise TrainingError(
            f"frames must be at least {least_px} px a side, as the patches are; got {mask.shape}"
        )
    crop = body_crop(mask, _CROP_MARGIN) or (slice(0, mask.shape[0]), slice(0, mask.shape[1]))
    crop = tuple(_widened(s, n, least_px) for s, n in zip(crop, mask.shape, strict=True))
    rgba = np.concatenate([over_black(image, mask)[crop], mask[crop][..., None]], axis=2)
    window = camera.cropped(crop[1].start, crop[0].start, rgba.shape[1], rgba.shape[0])
    scale = 1.0 if most_px is None else min(1.0, most_px / max(rgba.shape[:2]))
    if scale < 1.0:
        import cv2

        window = window.resized(round(scale * window.width), round(scale * window.height))
        rgba = cv2.resize(rgba, (window.width, window.height), interpolation=cv2.INTER_AREA)
    pose = source.pose(index)
    return TrainingView(
        rgba, window.rays()[1], camera.position, pose.joint_angles, pose.root_translation, device
    )


def _widened(span: slice, side: int, least: int) -> slice:
    """`span` grown to `least` pixels within 0 .. `side`."""
    missing = max(0, least - (span.stop - span.start))
    start = min(max(0, span.start - missing // 2), side - (span.stop - span.start) - missing)
    return slice(start, start + span.stop - span.start + missing)
