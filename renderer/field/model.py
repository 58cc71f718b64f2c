"""FieldModel: a trained field as everyone else sees it (a `PerformerModel`)."""

from __future__ import annotations

import zlib
from copy import copy
from functools import cached_property
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from renderer.devices import best_device, on_device, on_host
from renderer.field.field import PersonField
from renderer.field.networks.canonical import NarrowBand
from renderer.field.rendering.field_renderer import FieldRenderer
from renderer.field.rendering.occupancy_grid import OccupancyGrid
from renderer.field.sizes import FieldSizes
from scene.arrays import Array, Bool, Float
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.skeleton import Skeleton

if TYPE_CHECKING:
    from renderer.presets import Preset

_LEARNT = "field."


class FieldModel:
    """One person's field with the clip's motion (a `PerformerModel`)."""

    kind = "field"
    splats = None

    def __init__(
        self,
        field: PersonField,
        *,
        preset: str,
        motion: Motion,
        data_hash: str,
        metrics: dict[str, Any],
    ) -> None:
        self.field = field.eval().requires_grad_(False)
        self.preset = preset
        self.motion = motion
        self.data_hash = data_hash
        self.metrics = metrics

    @property
    def skeleton(self) -> Skeleton:
        """The person's own joints."""
        return self.field.skeleton

    @cached_property
    def _renderer(self) -> FieldRenderer:
        return FieldRenderer(self.field)

    def render(self, camera: Camera, pose: Pose) -> Float[Array, "H W 4"]:
        """Premultiplied sRGB and alpha of the person in `pose` seen by `camera`."""
        return self._renderer.render(camera, pose)

    def filmed_parts(self) -> FieldModel:
        """Itself: a field keeps no record of what was captured."""
        return self

    def drawn_as(self, preset: Preset) -> FieldModel:
        """The same weights, drawn with the speed-ups of `preset`.

        Raises InvalidInput for a preset that is not a field's.
        """
        field = copy(self.field)
        field.sizes = preset.field_settings.sizes
        return FieldModel(
            field,
            preset=self.preset,
            motion=self.motion,
            data_hash=self.data_hash,
            metrics=self.metrics,
        )

    def tensors(self) -> dict[str, Array]:
        """What a model file holds beside motion and skeleton; `from_tensors` takes it back.

        The grid's table is kept in half precision (far below a byte's step in colour), the prior in
        bytes, which it was rounded to when it was made, the shell in bits, and what is occupied in
        bits that are packed again: most of it is empty. A baked weight volume takes the prior's
        place, as it is.
        """
        field = self.field
        stored = {_LEARNT + name: on_host(p) for name, p in field.named_parameters()}
        table = _LEARNT + "canonical.table"
        if table in stored:
            stored[table] = stored[table].astype(np.float16)
        stored["box"] = on_host(torch.stack([field.low, field.high]))
        prior = field.motion.prior
        in_bytes = torch.round(prior * 255.0).to(torch.uint8)
        stored["prior"] = on_host(prior if field.sizes.baked else in_bytes)
        if field.occupied is not None:
            bits = np.packbits(on_host(field.occupied.live), axis=None)
            stored["occupied"] = np.frombuffer(zlib.compress(bits.tobytes()), np.uint8)
        if field.shell is not None:
            stored["shell"] = np.packbits(field.shell.learnt, axis=None)
            stored["deep"] = np.packbits(field.shell.deep, axis=None)
        return stored

    def header(self) -> dict[str, Any]:
        """Sizes, as the header of a model file holds them."""
        shape = None if self.field.shell is None else list(self.field.shell.learnt.shape)
        return {
            "sizes": self.field.sizes.to_json(),
            "grid_shape": shape,
            "residual_opened": self.field.residual_opened,
            "occupied_shape": None if self.field.occupied is None else self.field.occupied.shape,
        }

    @classmethod
    def from_tensors(
        cls, tensors: dict[str, Array], about: dict[str, Any], skeleton: Skeleton, motion: Motion
    ) -> FieldModel:
        """The model in a file. Raises KeyError, ValueError or RuntimeError for parts that are
        missing or do not fit."""
        sizes = FieldSizes.from_json(about["sizes"])
        device = best_device()
        low, high = on_device(tensors["box"], device).unbind()
        prior = on_device(tensors["prior"], device, torch.float32)
        if tensors["prior"].dtype == np.uint8:
            prior = prior / 255.0
        shell = None
        if about["grid_shape"] is not None:
            learnt, deep = (_unpacked(tensors[k], about["grid_shape"]) for k in ("shell", "deep"))
            shell = NarrowBand(learnt, deep)
        learnt_state = {
            name[len(_LEARNT) :]: on_device(value, device, torch.float32)
            for name, value in tensors.items()
            if name.startswith(_LEARNT)
        }
        # without memory at first: sizes that the file has no weights for would take any amount
        with torch.device("meta"):
            expected = _shapes(PersonField(sizes, skeleton, prior, low, high, shell))
        if (got := {name: tuple(one.shape) for name, one in learnt_state.items()}) != expected:
            raise ValueError(f"learnt tensors must be {expected}; got {got}")
        field = PersonField(sizes, skeleton, prior, low, high, shell).to(device)
        field.load_state_dict(learnt_state, strict=False)
        field.residual_opened = about["residual_opened"]
        shape = about["occupied_shape"]
        if shape is not None:
            packed = tensors["occupied"].tobytes()
            unpacked = zlib.decompressobj().decompress(packed, -(-prod(shape) // 8) + 1)
            bits = np.frombuffer(unpacked, np.uint8)
            live = on_device(_unpacked(bits, shape).reshape(-1), device)
            field.occupied = OccupancyGrid(field.low, field.high, tuple(shape), live)
        return cls(
            field,
            preset=about["preset"],
            motion=motion,
            data_hash=about["data_hash"],
            metrics=about["metrics"],
        )


def _shapes(field: PersonField) -> dict[str, tuple[int, ...]]:
    return {name: tuple(one.shape) for name, one in field.named_parameters()}


def _unpacked(bits: Array, shape: list[int]) -> Bool[Array, "..."]:
    if min(shape, default=0) < 1 or len(bits) != -(-prod(shape) // 8):
        raise ValueError(f"a grid of {shape} must have a bit a point; got {len(bits)} bytes")
    return np.unpackbits(bits, count=prod(shape)).reshape(shape).astype(bool)
