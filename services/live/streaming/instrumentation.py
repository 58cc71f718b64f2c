"""Where measuring hooks into what is sent to viewers."""

from __future__ import annotations

from av import VideoFrame

from services.live.room import Room


class Instrumentation:
    """Called for each picture and each pose before it is encoded; as it stands, changes nothing.

    A subclass is passed to the view sessions where something is to be measured.
    """

    def on_picture(self, room: Room, frame: VideoFrame) -> None:
        """Take a picture of `room` (yuv420p) that has just been drawn; may write into it."""

    def pose_time_ms(self, room: Room, now_s: float) -> float:
        """The capture time, ms, that pose packets of `room` carry when sent at `now_s`."""
        return 1000.0 * now_s
