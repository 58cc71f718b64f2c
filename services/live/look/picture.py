"""What comes of a sent picture, and who takes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera
from scene.live_appearance import LiveAppearance
from scene.motion import Pose
from services.live.look.keeping import Keeping


@dataclass(frozen=True, eq=False)
class LookPicture:
    """A person cut out of one picture of their webcam."""

    captured_ms: float
    """Capture time in ms, modulo 65,536: whole ms of that of the keypoints from this picture."""
    window: tuple[int, int, int]
    """x, y and side of the square, px of the webcam's picture; it may reach beyond."""
    rgb: UInt8[Array, "384 384 3"]
    """sRGB; black where the matte is 0."""
    matte: UInt8[Array, "384 384"]
    """0 (not the person) to 255 (the person)."""


@dataclass(frozen=True, eq=False)
class AlignedPose:
    """Where somebody was in a picture, as pages need it that colour a model by that picture."""

    pose: Pose
    """Aligned with the picture."""
    pelvis: Float[Array, "3"]
    """Where its pelvis is, m."""
    camera: Camera
    """Of the sent picture, in the world of `pose`."""
    moment_s: float
    """When they were there, by the clock of what is drawn."""


@dataclass(frozen=True, eq=False)
class PoseRequest:
    """That pages which draw want the pose of a picture."""

    model: PerformerModel
    """Whom they draw."""
    deliver: Callable[[AlignedPose], None]
    """Called once it is known, if it ever is; on any thread."""


class LookSink(Protocol):
    """Shows one performer as they look now."""

    @property
    def keeping(self) -> Keeping | None:
        """What is kept of the pictures; None where none can be."""
        ...

    def receive(self, picture: LookPicture, request: PoseRequest | None = None) -> None:
        """Take the newest picture; returns at once. On the event loop."""
        ...

    def stop(self) -> None:
        """Show none any more, at once; the next may come later. May be called repeatedly. On the
        event loop."""
        ...

    def shown_of(self, model: PerformerModel) -> ShownLook | None:
        """How `model`, which is drawn now, looks now; None without a picture. On any thread."""
        ...


@dataclass(frozen=True, eq=False)
class ShownLook:
    """What a picture makes of a performer."""

    appearance: LiveAppearance
    behind_s: float
    """How much later than its moment the picture is shown: their motion waits for it."""


class DroppedPictures(LookSink):
    """Shows none."""

    @property
    def keeping(self) -> Keeping | None:
        """None."""
        return None

    def receive(self, picture: LookPicture, request: PoseRequest | None = None) -> None:
        """Nothing."""

    def stop(self) -> None:
        """Nothing."""

    def shown_of(self, model: PerformerModel) -> ShownLook | None:
        """None."""
        return None
