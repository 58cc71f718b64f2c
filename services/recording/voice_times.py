"""When a voice was said, by its own time stamps: how late its packets come varies, they don't."""

from __future__ import annotations

from services.live.streaming.forwarding import OPUS_RATE

_HALF_RANGE = 1 << 31
_ANEW_MS = 500.0
"""A packet that comes later than this after its time is of another stream of time stamps."""
_CLOCK_DRIFT = 1e-3
"""ms a ms by which what is believed of the speaker's clock gives way."""

_ROUNDING_MS = 1e-6


class VoiceTimes:
    """Follows one speaker's packets, in the order in which they come.

    As `services.live.motion.live_motion` does with landmarks, the speaker's clock is told from ours
    by the packets that came quickest.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._said_ms = self._offset_ms = 0.0

    def at_ms(self, timestamp: int, arrived_ms: float) -> int:
        """When the packet of RTP's `timestamp` (48 kHz, modulo 2^32) that came at `arrived_ms` was
        said, ms of our clock, and no later than it came."""
        step_ms = 0.0
        if self._last is not None:
            step = (timestamp - self._last + _HALF_RANGE) % (1 << 32) - _HALF_RANGE
            step_ms = 1e3 * step / OPUS_RATE
        offset_ms = arrived_ms - (self._said_ms + step_ms)
        believed_ms = self._offset_ms + _CLOCK_DRIFT * max(step_ms, 0.0)
        known = self._last is not None and offset_ms < believed_ms + _ANEW_MS
        self._offset_ms = min(offset_ms, believed_ms) if known else offset_ms
        self._last, self._said_ms = timestamp, self._said_ms + step_ms
        return int(self._said_ms + self._offset_ms + _ROUNDING_MS)
