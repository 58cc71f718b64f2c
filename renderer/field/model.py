"""FieldModel: a trained field as everyone else sees it (a `PersonModel`)."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from renderer.field.drawing import FieldRenderer
from renderer.field.field import PersonField
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.skeleton import Skeleton


class FieldModel:
    """One person's field with the clip's motion."""

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
