"""Where measuring hooks into what is sent to viewers."""

from __future__ import annotations

from typing import Protocol

from services.live.room import Room


class PictureTimes(Protocol):
    """Is told how a picture goes on; times are of the view sessions' clock, s."""

    def drawn(self, now_s: float) -> None:
        """It has been drawn."""
        ...

    def coded(self, now_s: float, width: int, height: int) -> None:
        """It has been encoded, and goes out."""
        ...


class Instrumentation:
    """Called for each picture and each pose before it is encoded; as it stands, changes nothing.

    A subclass is passed to the view sessions where something is to be measured.
    """

    def begin_picture(self, room: Room, now_s: float) -> PictureTimes | None:
        """A picture of `room` is about to be drawn as it is now; None: nobody asks how it goes."""
        return None

    def stamp_ms(self, room: Room) -> float | None:
        """The capture time to write into the corner of a picture of `room`
        (services.live.streaming.latency_code); None: nothing is written."""
        return None

    def pose_time_ms(self, room: Room, now_s: float) -> float:
        """The capture time, ms, that pose packets of `room` carry when sent at `now_s`."""
        return 1000.0 * now_s
