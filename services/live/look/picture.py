"""What comes of a sent picture, and who takes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from scene.arrays import Array, UInt8


@dataclass(frozen=True, eq=False)
class LookPicture:
    """A person cut out of one picture of their webcam."""

    captured_ms: float
    """Capture time in ms, modulo 65,536: whole ms of that of the keypoints from this picture."""
    window: tuple[int, int, int]
    """x, y and side of the square, px of the webcam's picture; it may reach beyond."""
    rgb: UInt8[Array, "288 288 3"]
    """sRGB; black where the matte is 0."""
    matte: UInt8[Array, "288 288"]
    """0 (not the person) to 255 (the person); twice enlarged."""


class LookSink(Protocol):
    """Shows one performer as they look now. Both methods are called on the event loop."""

    def receive(self, picture: LookPicture) -> None:
        """Take the newest picture; returns at once."""
        ...

    def stop(self) -> None:
        """Show none any more, at once; the next may come later. May be called repeatedly."""
        ...


class DroppedPictures(LookSink):
    """Shows none."""

    def receive(self, picture: LookPicture) -> None:
        """Nothing."""

    def stop(self) -> None:
        """Nothing."""
