"""When a picture is due, how large and detailed it may be, what is sent again; times are the
caller's.

Time is cut into ticks of 1/30 s, the same for all viewers of a process, so that viewers with the
same viewpoint share a picture. Of each tick a viewer gets at most one picture, the newest; ticks
that were missed are skipped.
"""

from __future__ import annotations

from renderer.splats.levels.detail import FULL_DENSITY, LEAST_DENSITY, ViewDetail
from services.live.streaming.encoding import FRAMES_PER_SECOND

TICK_S = 1.0 / FRAMES_PER_SECOND
SCALES = (1.0, 0.75, 0.5)
"""Of the sides that a viewer asks for."""
_WINDOW_S = 2.0
_SLOW_SHARE, _FLUENT_SHARE = 0.6, 0.95
"""Of 30 pictures a second: with fewer a picture is too large; with more none is late."""
_SLOW_WINDOWS, _FLUENT_WINDOWS = 2, 3
"""Our page asks for smaller pictures after 3 s; other clients are given them after 4 s."""
_BUSY_SHARE = 0.7
"""Of the drawing thread's time: a larger picture must fit in this."""
_LONGEST_WAIT = 48
"""Windows, between enlargements that had to be taken back."""
_DETAIL_WINDOW_S = 0.4
_CALM_SHARE, _OVERLOADED_SHARE = 0.6, 0.85
"""Of the drawing thread's time: below, people get more splats, above, fewer."""
_DETAIL_STEP, _LARGEST_DETAIL_STEP = 1.15, 2.0
_RESEND_SHARE = 0.25
"""Of the bitrate: a connection that loses more is congested."""
_PACKET_BITS = 8 * 1200
"""Size of a usual packet of video, bits."""


class ResendBudget:
    """How many lost packets may be retransmitted: a token bucket that holds one second's worth."""

    def __init__(self) -> None:
        self._tokens, self._updated_s = 0.0, -1.0

    def take(self, now_s: float, requested: int, bitrate: int) -> int:
        """How many of `requested` packets fit beside a stream of `bitrate` bit/s."""
        per_second = _RESEND_SHARE * bitrate / _PACKET_BITS
        self._tokens = min(per_second, self._tokens + per_second * (now_s - self._updated_s))
        self._updated_s = now_s
        granted = min(requested, int(self._tokens))
        self._tokens -= granted
        return granted


class DetailGovernor:
    """Draws people by fewer splats while the drawing thread has too much to do, by more when not.

    Pictures get smaller (`SizeGovernor`) only where that is not enough.
    """

    def __init__(self, detail: ViewDetail) -> None:
        self._detail = detail
        self._started_s: float | None = None
        self._pictures, self._all_s = 0, 0.0

    def add_picture(self, now_s: float, all_s: float, scale: float) -> None:
        """Note a picture done at `now_s`, of `scale` times the sides that were asked for.

        `all_s` counts what the drawing thread has worked for everybody since it began, s.
        """
        if self._started_s is None or not self._detail.settled:
            self._begin(now_s, all_s)
            return
        self._pictures += 1
        length_s = now_s - self._started_s
        if length_s < _DETAIL_WINDOW_S:
            return
        busy, detail = (all_s - self._all_s) / length_s, self._detail
        if busy > _OVERLOADED_SHARE:
            # ticks that everybody's pictures take while this viewer gets one
            late = (all_s - self._all_s) / (self._pictures * TICK_S)
            step = min(max(late / _OVERLOADED_SHARE, _DETAIL_STEP), _LARGEST_DETAIL_STEP)
            density = min(detail.density, detail.density_drawn) / step
            detail.density = max(LEAST_DENSITY, density)
        elif busy < _CALM_SHARE and scale == 1.0:
            detail.density = min(FULL_DENSITY, detail.density * _DETAIL_STEP)
        self._begin(now_s, all_s)

    def _begin(self, now_s: float, all_s: float) -> None:
        self._started_s, self._pictures, self._all_s = now_s, 0, all_s

    def pause(self) -> None:
        """Forget what was measured: no pictures are drawn for a while."""
        self._started_s = None


class FramePacer:
    """The ticks of one viewer."""

    def __init__(self) -> None:
        self._last = -1

    def wait_s(self, now_s: float) -> float:
        """Time until the next picture is due, s; nil where it is late."""
        if self._last < 0 or int(now_s / TICK_S) > self._last:
            return 0.0
        return (self._last + 1) * TICK_S - now_s

    def begin(self, now_s: float) -> int:
        """Start the newest picture; returns its tick. Those before it are dropped."""
        # a clock that wakes us a rounding error early must not give one tick twice
        self._last = max(int(now_s / TICK_S), self._last + 1)
        return self._last


class SizeGovernor:
    """Shrinks pictures where they come too slowly, and enlarges them again where there is time.

    An enlargement that had to be taken back makes the next one wait twice as long.
    """

    def __init__(self) -> None:
        self._step = 0
        self._started_s: float | None = None
        self._pictures = 0
        self._own_s, self._all_s = 0.0, 0.0
        self._slow, self._fluent = 0, 0
        self._wait = _FLUENT_WINDOWS
        self._enlarged = False

    @property
    def scale(self) -> float:
        """Of the sides asked for, one of `SCALES`."""
        return SCALES[self._step]

    def add_picture(self, now_s: float, own_s: float, all_s: float) -> None:
        """Note a picture that was done at `now_s` and took `own_s` to draw and encode.

        `all_s` counts what the drawing thread has worked for everybody since it began, s.
        """
        if self._started_s is None:
            self._begin(now_s, all_s)
            return
        self._pictures += 1
        self._own_s += own_s
        length_s = now_s - self._started_s
        if length_s < _WINDOW_S:
            return
        share = self._pictures / length_s / FRAMES_PER_SECOND
        self._judge(share, self._own_s / length_s, (all_s - self._all_s) / length_s)
        self._begin(now_s, all_s)

    def pause(self) -> None:
        """Forget what was measured: no pictures are drawn for a while."""
        self._started_s = None
        self._slow = self._fluent = 0

    def _begin(self, now_s: float, all_s: float) -> None:
        self._started_s, self._pictures, self._own_s, self._all_s = now_s, 0, 0.0, all_s

    def _judge(self, share: float, own: float, busy: float) -> None:
        self._slow = self._slow + 1 if share < _SLOW_SHARE else 0
        self._fluent = self._fluent + 1 if share >= _FLUENT_SHARE else 0
        if self._slow >= _SLOW_WINDOWS and self._step < len(SCALES) - 1:
            if self._enlarged:
                self._wait = min(2 * self._wait, _LONGEST_WAIT)
            self._move(self._step + 1, enlarged=False)
        elif self._fluent >= self._wait and self._step > 0:
            growth = (SCALES[self._step - 1] / SCALES[self._step]) ** 2
            if busy + (growth - 1.0) * own < _BUSY_SHARE:
                self._move(self._step - 1, enlarged=True)

    def _move(self, step: int, *, enlarged: bool) -> None:
        self._step, self._enlarged = step, enlarged
        self._slow = self._fluent = 0
