"""The renderer of splats on a GPU, by our own Triton kernels; what calls it sees no difference.

Splats, blend weights and joints stay on the device; what goes there each frame are the transforms
and the camera, and colours where a room's light falls on people. The picture comes back to the host
in single precision, since rooms, shadows and the encoder's planes are made there.
"""

from __future__ import annotations

from collections.abc import Sequence as Many
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch

from renderer.splats.layout import BOX_FILTER_PX2, COLOUR, OPACITY, POSITION, TILE
from renderer.splats.rasteriser.renderer import Geometry, LaidOnModel, SplatRenderer
from renderer.splats.rasteriser.workspace import pack_camera
from renderer.splats.skinned import SkinnedSplats
from scene.arrays import Array, Bool, Float, Tensor
from scene.camera import Camera

_BLOCK_TILES = 4
"""Tiles a side of a block: few enough blocks that each may go through all splats."""
_SPLATS_A_PROGRAM = 128
_LISTED_AT_ONCE = 1024
_BLENDED_AT_ONCE = 256
_COLOURS = slice(6, 9)
"""Of what the kernels write of a splat."""


def splat_renderer(models: Many[SkinnedSplats]) -> SplatRenderer:
    """The fastest renderer that this machine has for a set of models."""
    # the device has no cloth
    tight = all(model.cloth is None for model in models)
    if tight and torch.cuda.is_available() and find_spec("triton") is not None:
        return GpuSplatRenderer(models, torch.device("cuda"))
    return SplatRenderer(models)


def _kernels() -> Any:
    """The Triton kernels, imported when first needed: renderer/ runs without Triton too."""
    from renderer.splats.rasteriser import gpu_kernels

    return gpu_kernels


class GpuSplatRenderer(SplatRenderer):
    """Renders a set of models on `device`: CUDA, or the CPU under Triton's interpreter."""

    def __init__(self, models: Many[SkinnedSplats], device: torch.device) -> None:
        super().__init__(models)
        self._device = device
        self._on_device = torch.from_numpy(self._parameters.copy()).to(device)
        self._device_joints = torch.from_numpy(self._joints.astype(np.int32)).to(device)
        self._device_weights = torch.from_numpy(self._weights).to(device)
        self._device_splats = torch.from_numpy(self._blend_shapes.splats).long().to(device)
        self._device_rest = torch.from_numpy(self._blend_shapes.rest).to(device)
        self._device_offsets = torch.from_numpy(self._blend_shapes.offsets).to(device)
        self._device_owner = torch.from_numpy(self._blend_shapes.owner).long().to(device)
        self._lit_once = False
        self._buffers: _Buffers | None = None
        self._camera: Camera | None = None

    def draw_only(self, drawn: Bool[Array, "N"]) -> None:
        """As on the CPU; the change goes to the device."""
        changed = np.flatnonzero(drawn != self._drawn)
        super().draw_only(drawn)
        if len(changed):
            opacity = torch.from_numpy(self._parameters[changed, OPACITY]).to(self._device)
            self._on_device[torch.from_numpy(changed).to(self._device), OPACITY] = opacity

    def _rasterise(
        self,
        parameters: Float[Array, "N P"],
        moved: Float[Array, "K 4 4"],
        camera: Camera,
        colours: Float[Array, "N 3"] | None = None,
        layings: Many[LaidOnModel] = (),
    ) -> Float[Array, "H W 4"]:
        lit = colours is not None or parameters is not self._parameters
        if lit or self._lit_once:
            if colours is None:
                colours = np.ascontiguousarray(parameters[:, COLOUR : COLOUR + 3])
            self._on_device[:, COLOUR : COLOUR + 3] = torch.from_numpy(colours).to(self._device)
            self._lit_once = lit
        if self._blend_shapes.any:
            self._apply_expressions_on_device()
        self._camera = camera
        buffers = self.draw(moved, camera)
        buffers.host.copy_(buffers.out, non_blocking=True)
        buffers.busy_on_host.copy_(buffers.busy, non_blocking=True)
        if self._device.type == "cuda":
            torch.cuda.current_stream(self._device).synchronize()
        view = buffers.host.numpy()
        self._lay(layings, view)
        return view

    def _apply_expressions_on_device(self) -> None:
        shown = torch.from_numpy(self._blend_shapes.shown).to(self._device)[self._device_owner]
        places = self._device_rest + torch.einsum("me,mex->mx", shown, self._device_offsets)
        self._on_device[self._device_splats, POSITION : POSITION + 3] = places

    def draw(self, moved: Float[Array, "K 4 4"], camera: Camera) -> _Buffers:
        """Draw on the device, unlit or as lit last; returns without waiting for it."""
        kernels = _kernels()
        count, width, height = len(self._on_device), camera.width, camera.height
        b = self._buffers
        if b is None or b.size != (width, height):
            b = self._buffers = _Buffers(count, width, height, self._device)
        sent = torch.from_numpy(np.concatenate([moved, pack_camera(camera)[None]]))
        moved_and_camera = sent.to(self._device)
        grid = (-(-count // _SPLATS_A_PROGRAM),)
        kernels.project[grid](
            self._on_device,
            self._device_joints,
            self._device_weights,
            moved_and_camera,
            moved_and_camera[-1],
            count,
            width,
            height,
            BOX_FILTER_PX2,
            b.shown,
            b.depth,
            b.boxes,
            BLOCK=_SPLATS_A_PROGRAM,
        )
        order = torch.argsort(b.depth)
        kernels.list_blocks[(b.blocks,)](
            order,
            b.boxes,
            count,
            b.blocks_x,
            b.lists,
            b.lengths,
            SIDE=_BLOCK_TILES,
            PIECE=_LISTED_AT_ONCE,
        )
        self._blend_tiles(b, b.out)
        return b

    def _blend_tiles(self, b: _Buffers, out: Tensor) -> None:
        """A picture of what `b.shown` holds as colours."""
        count, (width, height) = len(self._on_device), b.size
        _kernels().blend[(len(b.busy),)](
            b.shown,
            b.boxes,
            b.lists,
            b.lengths,
            count,
            width,
            height,
            b.tiles_x,
            b.blocks_x,
            b.kept,
            b.busy,
            out,
            SIDE=_BLOCK_TILES,
            PIECE=_BLENDED_AT_ONCE,
        )

    def _means(self) -> Float[Array, "N 2"]:
        assert self._buffers is not None
        return self._buffers.shown[:, :2].cpu().numpy()

    def _blend_in_view(self, values: Float[Array, "N 3"]) -> Float[Array, "H W 4"]:
        b = self._buffers
        assert b is not None
        b.shown[:, _COLOURS] = torch.from_numpy(values).to(self._device)
        out = torch.empty_like(b.out)
        self._blend_tiles(b, out)
        return out.cpu().numpy()

    def geometry(self, transforms: Many[Float[Array, "K 4 4"]]) -> Geometry:
        """Of the picture that was rendered last, worked out on the CPU: no live view asks."""
        assert self._camera is not None
        moved = np.concatenate(list(transforms)).astype(np.float32)
        super()._rasterise(self._parameters, moved, self._camera)
        return super().geometry(transforms)

    @property
    def tiles(self) -> Bool[Array, "tH tW"]:
        """Which tiles of the last picture anybody is in."""
        assert self._buffers is not None
        return self._buffers.busy_on_host.numpy().reshape(self._buffers.tiles_y, -1)


class _Buffers:
    """All that a picture of one size needs."""

    def __init__(self, count: int, width: int, height: int, device: torch.device) -> None:
        self.size = (width, height)
        self.tiles_x, self.tiles_y = -(-width // TILE), -(-height // TILE)
        self.blocks_x = -(-self.tiles_x // _BLOCK_TILES)
        self.blocks = self.blocks_x * -(-self.tiles_y // _BLOCK_TILES)
        tiles = self.tiles_x * self.tiles_y

        def made(*shape: int, dtype: torch.dtype = torch.float32) -> Tensor:
            return torch.zeros(*shape, dtype=dtype, device=device)

        def on_host(like: Tensor) -> Tensor:
            return torch.zeros(
                like.shape, dtype=like.dtype, device="cpu", pin_memory=device.type == "cuda"
            )

        self.shown = made(count, _kernels().SHOWN)
        self.depth = made(count)
        self.boxes = made(count, 4, dtype=torch.int32)
        self.lists = made(self.blocks, count, dtype=torch.int32)
        self.lengths = made(self.blocks, dtype=torch.int32)
        self.kept = made(tiles, _BLENDED_AT_ONCE, dtype=torch.int32)
        self.busy = made(tiles, dtype=torch.bool)
        self.busy_on_host = on_host(self.busy)
        self.out = made(height, width, 4)
        self.host = on_host(self.out)
