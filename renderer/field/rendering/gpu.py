"""A field drawn by fused Triton kernels: the paper's presets with all their speed-ups, on a GPU.

What the CPU's path skips by cells of the posed body, ray by ray, is cheaper to ask here: one kernel
brings every sample of every ray into the canonical space, and only those that are likely, and lie
where the trained field holds anything, go on to the networks.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
import torch
from torch import nn

from renderer.devices import on_device
from renderer.field.networks.canonical import DENSITY_SCALE, START_DENSITY
from renderer.field.networks.encoding import hann_window
from renderer.field.networks.mlps import Mlp
from renderer.field.rendering.occupancy_grid import OccupancyGrid
from renderer.field.skinning.posed_body import LEAST_LIKELIHOOD
from renderer.fused.mlp import WARPS
from scene.arrays import Array, Float, Int, Tensor
from scene.camera import Camera

if TYPE_CHECKING:
    from renderer.field.field import PersonField
    from renderer.field.skinning.inverse_skinning import WeightVolume
    from renderer.field.skinning.posed_body import Support

_SAMPLES_A_PROGRAM = 32
"""Of those that run networks."""
_PLACES_A_PROGRAM = 128
_RAYS_A_PROGRAM = 128
_PADDED = 64
"""Columns of an encoding: 63 of the canonical one, 36 of the residual's."""
_OUTPUTS = 16


def draws(field: PersonField, device: torch.device) -> bool:
    """Whether the fused kernels draw `field` on `device`, as the other path does."""
    sizes = field.sizes
    fused = sizes.backend == "fused" and sizes.cull and sizes.occupancy and sizes.early_stop
    plain = sizes.grid is None and not sizes.posed_grid and not sizes.inverse_rounds
    known = field.occupied is not None and sizes.samples_a_ray > 0
    return device.type == "cuda" and find_spec("triton") is not None and fused and plain and known


def _kernels() -> Any:
    """The Triton kernels, imported when first needed: renderer/ runs without Triton too."""
    from renderer.field.rendering import gpu_kernels

    return gpu_kernels


class _Posed(NamedTuple):
    """What brings samples of rays into the canonical space, in the kernels' order."""

    view: Tensor
    box: Tensor
    transforms: Tensor
    reaches: Tensor
    volume: Tensor
    channels: Tensor


@dataclass(frozen=True, eq=False)
class _Network:
    """Weights of an MLP as the kernels read them: [in, out], padded, half precision."""

    first: Tensor
    shared: Float[Tensor, "S W"] | None
    hidden: Tensor
    again: Tensor
    last: Tensor
    sizes: dict[str, int]

    @classmethod
    def of(cls, mlp: Mlp, inputs: int, skip: int) -> _Network:
        """`inputs` of the first layer belong to each sample, the others to the pose."""
        first, *others = (cast(nn.Linear, layer).weight.T for layer in mlp.hidden)
        width = first.shape[1]
        hidden, again = [weight[:width] for weight in others], others[skip - 2][width:]
        last = mlp.last.weight.T
        return cls(
            _padded(first[:inputs], _PADDED, width),
            first[inputs:].contiguous() if len(first) > inputs else None,
            torch.stack(hidden).to(torch.float16).contiguous(),
            _padded(again, _PADDED, width),
            _padded(last, width, _OUTPUTS),
            {
                "INPUTS": _PADDED,
                "WIDTH": width,
                "OUTPUTS": _OUTPUTS,
                "DEPTH": len(mlp.hidden),
                "SKIP": skip,
            },
        )

    def arguments(self, window: Tensor, pose: Float[Tensor, "S"] | None) -> tuple[Tensor, ...]:
        """What a kernel takes of it, with the pose's share of the first layer."""
        offset = torch.zeros(self.first.shape[1], device=window.device)
        if pose is not None and self.shared is not None:
            offset = pose @ self.shared
        return window, self.first, offset, self.hidden, self.again, self.last


def _padded(weight: Tensor, rows: int, columns: int) -> Tensor:
    made = torch.zeros(rows, columns, dtype=torch.float16, device=weight.device)
    made[: weight.shape[0], : weight.shape[1]] = weight.detach().to(torch.float16)
    return made


class FusedDrawing:
    """Draws one field whose weights stay as they are."""

    def __init__(self, field: PersonField, volume: WeightVolume, support: Support) -> None:
        self._field = field
        self._device = volume.low.device
        sizes = field.sizes
        assert sizes.colour is not None
        assert sizes.colour.skip is not None
        mlp = field.canonical.mlp
        assert mlp is not None
        self._colour = _Network.of(mlp, 3 + 6 * sizes.octaves, sizes.colour.skip)
        self._colour_window = self._window(
            torch.ones(sizes.octaves, device=self._device), identity=True
        )
        self._residual = None
        if field.residual is not None and sizes.residual is not None:
            assert sizes.residual.skip is not None
            inputs = 6 * sizes.residual_octaves
            self._residual = _Network.of(field.residual.mlp, inputs, sizes.residual.skip)
        low = torch.maximum(support.bone_low, volume.low)
        high = torch.minimum(support.bone_high, volume.high)
        self._reaches = torch.cat([low, high], dim=1).contiguous()
        depth, height, width = volume.shape
        points = torch.tensor([width - 1.0, height - 1.0, depth - 1.0], device=self._device)
        self._volume = torch.cat([volume.low, points / (volume.high - volume.low)])
        self._channels = volume.channels[:-1].contiguous()
        self._shape = volume.shape
        self._joints = len(support.bone_low)
        self._host: Tensor | None = None

    def render(
        self,
        camera: Camera,
        box: tuple[Float[Tensor, "3"], Float[Tensor, "3"]],
        transforms: Float[Tensor, "K 3 4"],
        joint_angles: Float[Tensor, "K 3"],
        before: OccupancyGrid,
    ) -> Float[Array, "H W 4"]:
        """Premultiplied RGBA; the next call overwrites it.

        Args:
            camera: of the window that is drawn, without distortion.
            box: low and high corner of the posed body, m.
            transforms: M_i (rest -> world).
            before: where canonical points may lie before residual motion.
        """
        slots = self._field.sizes.samples_a_ray
        posed = _Posed(
            self._view(camera),
            torch.cat(box),
            transforms.contiguous(),
            self._reaches,
            self._volume,
            self._channels,
        )
        samples, counts, steps = self._march(posed, camera, before)
        picture = torch.zeros(len(counts), 4, device=self._device)
        if count := len(samples):
            found = torch.empty(count, 4, device=self._device)
            _kernels().skin[(-(-count // _PLACES_A_PROGRAM),)](
                samples,
                count,
                *posed,
                steps,
                camera.width,
                *self._shape,
                found,
                JOINTS=self._joints,
                SLOTS=slots,
                BLOCK=_PLACES_A_PROGRAM,
            )
            self._move(found, joint_angles)
            rgba = self._evaluate(samples, found, steps)
            _kernels().composite[(-(-len(counts) // _RAYS_A_PROGRAM),)](
                rgba, counts.cumsum(0), counts, len(counts), picture, BLOCK=_RAYS_A_PROGRAM
            )
        return self._on_host(picture).reshape(camera.height, camera.width, 4)

    def _march(
        self, posed: _Posed, camera: Camera, before: OccupancyGrid
    ) -> tuple[Int[Tensor, "N"], Int[Tensor, "R"], Float[Tensor, "R"]]:
        """Samples that may show anything, in order; how many of each ray; and its step, m."""
        rays, slots = camera.width * camera.height, self._field.sizes.samples_a_ray
        kept = torch.empty(rays * slots, dtype=torch.int8, device=self._device)
        counts = torch.empty(rays, dtype=torch.int32, device=self._device)
        steps = torch.empty(rays, device=self._device)
        _kernels().march[(rays,)](
            *posed,
            *_cells(before),
            kept,
            counts,
            steps,
            camera.width,
            *self._shape,
            *before.shape,
            JOINTS=self._joints,
            SLOTS=slots,
            LEAST=LEAST_LIKELIHOOD,
            BLOCK=_power_of_two(slots),
            num_warps=1,
        )
        return torch.nonzero(kept)[:, 0], counts, steps

    def _evaluate(
        self, samples: Int[Tensor, "N"], found: Float[Tensor, "N 4"], steps: Float[Tensor, "R"]
    ) -> Float[Tensor, "N 4"]:
        """Colour and alpha of each sample; those that are not likely are not asked."""
        chosen = torch.nonzero(found[:, 3] > 0.0)[:, 0]
        rgba = torch.zeros(len(samples), 4, device=self._device)
        _kernels().evaluate[(max(1, -(-len(chosen) // _SAMPLES_A_PROGRAM)),)](
            chosen,
            len(chosen),
            samples,
            found,
            steps,
            *self._colour.arguments(self._colour_window, None),
            rgba,
            SCALE=DENSITY_SCALE,
            START=START_DENSITY,
            SLOTS=self._field.sizes.samples_a_ray,
            **self._colour.sizes,
            BLOCK=_SAMPLES_A_PROGRAM,
            num_warps=WARPS,
        )
        return rgba

    def _move(self, found: Float[Tensor, "N 4"], joint_angles: Float[Tensor, "K 3"]) -> None:
        """Residual motion of canonical points; what then lies nowhere is likely no more."""
        field, network, window = self._field, self._colour, self._colour_window
        opened, occupied = field.residual_opened, field.occupied
        assert occupied is not None
        if self._residual is not None and opened is not None:
            network = self._residual
            octaves = hann_window(field.sizes.residual_octaves, opened, self._device)
            window = self._window(octaves, identity=False)
        _kernels().move[(-(-len(found) // _SAMPLES_A_PROGRAM),)](
            found,
            len(found),
            *_cells(occupied),
            *occupied.shape,
            *network.arguments(window, joint_angles[1:].reshape(-1)),
            MOVED=network is self._residual,
            **network.sizes,
            BLOCK=_SAMPLES_A_PROGRAM,
            num_warps=WARPS,
        )

    def _on_host(self, picture: Float[Tensor, "R 4"]) -> Float[Array, "R 4"]:
        """In memory that the GPU writes without help: three times as fast as any other."""
        if self._host is None or len(self._host) < len(picture):
            pinned = self._device.type == "cuda"
            self._host = torch.empty(len(picture), 4, device="cpu", pin_memory=pinned)
        return self._host[: len(picture)].copy_(picture).numpy()

    def _view(self, camera: Camera) -> Float[Tensor, "18"]:
        """Rotation, eye, cx, cy, and what turns pixels into places of the plane z = 1."""
        lens = np.linalg.inv(camera.intrinsics[:2, :2])
        numbers = [camera.rotation, camera.position, camera.intrinsics[:2, 2], lens]
        flat = np.concatenate([part.reshape(-1) for part in numbers])
        return on_device(flat, self._device, torch.float32)

    def _window(self, octaves: Float[Tensor, "L"], *, identity: bool) -> Float[Tensor, "I"]:
        """Weight of every column of an encoding; nil where there is none."""
        made = torch.zeros(_PADDED, device=self._device)
        columns = octaves.repeat_interleave(6)
        start = 3 if identity else 0
        made[:start] = 1.0
        made[start : start + len(columns)] = columns
        return made


def _cells(cells: OccupancyGrid) -> tuple[Tensor, Tensor]:
    return cells.live, torch.cat([cells.low, 1.0 / cells.cell_m])


def _power_of_two(least: int) -> int:
    return 1 << (least - 1).bit_length()
