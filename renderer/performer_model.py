"""What every model of a person can do, whichever network or splats are inside."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.skeleton import Skeleton


@runtime_checkable
class PerformerModel(Protocol):
    """A trained model of one person."""

    @property
    def preset(self) -> str:
        """Name of the preset that it was trained with."""
        ...

    @property
    def skeleton(self) -> Skeleton:
        """The person's own joints."""
        ...

    @property
    def motion(self) -> Motion:
        """The motion of the clip it was trained on, as training left it."""
        ...

    @property
    def data_hash(self) -> str:
        """sha256 of the data that it was trained on."""
        ...

    @property
    def metrics(self) -> dict[str, Any]:
        """What training reported: steps, seconds, loss, what was never seen."""
        ...

    def render(self, camera: Camera, pose: Pose) -> Float[Array, "H W 4"]:
        """Premultiplied sRGB and alpha, float32, of the person in `pose` seen by `camera`."""
        ...
