"""Traces from a motion packet's arrival to the first picture that shows it, now and then one.

Spans are made after the fact, of moments that were noted on the way; so a packet costs nothing, and
a picture one look at a clock.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from weakref import WeakKeyDictionary

from services.live.room import Room
from services.live.streaming.instrumentation import Instrumentation, PictureTimes
from services.tracing import PastSpan, Tracing

INTERVAL_S = 5.0
"""Between two traced pictures of this process: people move thirty times a second each."""
NAME = "motion to picture"


class TracedPictures(Instrumentation):
    """Traces pictures beside what `inner` does with them. Pictures are begun on one thread."""

    def __init__(
        self, tracing: Tracing, inner: Instrumentation, clock: Callable[[], float]
    ) -> None:
        """`clock` is the view sessions', s."""
        self._tracing, self._inner = tracing, inner
        self._epoch_s = time.time() - clock()
        self._shown_s: WeakKeyDictionary[Room, float] = WeakKeyDictionary()
        self._traced_s = -math.inf

    def stamp_ms(self, room: Room) -> float | None:
        """See `Instrumentation.stamp_ms`."""
        return self._inner.stamp_ms(room)

    def pose_time_ms(self, room: Room, now_s: float) -> float:
        """See `Instrumentation.pose_time_ms`."""
        return self._inner.pose_time_ms(room, now_s)

    def begin_picture(self, room: Room, now_s: float) -> PictureTimes | None:
        """What notes how a picture goes on that is the first to show a packet, once in a while."""
        newest_s = room.newest_arrival_s
        before_s = self._shown_s.get(room, newest_s)
        self._shown_s[room] = newest_s
        if newest_s <= before_s or now_s - self._traced_s < INTERVAL_S:
            return None
        self._traced_s = now_s
        return _Traced(self._tracing, self._epoch_s, newest_s, now_s)


class _Traced(PictureTimes):
    def __init__(self, tracing: Tracing, epoch_s: float, arrived_s: float, began_s: float) -> None:
        self._tracing, self._epoch_s = tracing, epoch_s
        self._arrived_s, self._began_s, self._drawn_s = arrived_s, began_s, began_s

    def drawn(self, now_s: float) -> None:
        self._drawn_s = now_s

    def coded(self, now_s: float, width: int, height: int) -> None:
        moments = (self._arrived_s, self._began_s, self._drawn_s, now_s)
        arrived_s, began_s, drawn_s, coded_s = (self._epoch_s + one for one in moments)
        self._tracing.record(
            PastSpan(NAME, arrived_s, coded_s),
            [
                PastSpan("solve and wait", arrived_s, began_s),
                PastSpan("draw", began_s, drawn_s),
                PastSpan("encode", drawn_s, coded_s),
            ],
            attributes={"picture.width": width, "picture.height": height},
        )
