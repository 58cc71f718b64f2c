"""What comes over a driving channel: motion that a page has solved, or landmarks to be solved here.

Packets are read on the event loop. Motion is checked and followed at once, or kept to be passed on
where it is sealed; landmarks are solved on a thread of their own, and of each performer only the
newest waits.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Executor

from prometheus_client import Counter, Histogram

from scene.errors import InvalidInput
from services.live.keypoints_packet import KeypointsPacket, decode_keypoints
from services.live.motion.live_motion import LiveMotion
from services.live.motion.motion_packet import decode_motion, require_plausible
from services.live.motion.solved_motion import SolvedMotion
from services.live.packets import PacketError, is_newer
from services.live.sealed_packet import require_sealed

log = logging.getLogger(__name__)

Clock = Callable[[], float]

MOTIONS = Counter(
    "metanerf_motions_total",
    "Motion packets, which pages have solved, by what became of them.",
    ["outcome"],
)
"""followed; sealed (passed on unread); malformed; late (a newer one had come); implausible (faster
than anybody moves); flood (more of one performer in a second than any webcam gives)."""
_MOST_A_SECOND = 130
"""Motion packets of one performer: of the fastest webcams, 120."""
PACKETS = Counter(
    "metanerf_keypoints_total", "Keypoints packets, by what became of them.", ["outcome"]
)
"""solved; malformed; late (a newer one had come); replaced (by a newer one, while it waited);
no-person (no pose could be solved from it); flood (more in a second than any webcam gives)."""
TO_POSE_SECONDS = Histogram(
    "metanerf_keypoints_to_pose_seconds",
    "Time from a packet's arrival to its pose, s.",
    buckets=(0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5),
)


class _PacketRate:
    """Counts the packets of one performer in each second."""

    def __init__(self) -> None:
        self._second, self._packets = -1, 0

    def exceeded(self, now_s: float) -> bool:
        """Whether one more is more than any webcam gives."""
        if int(now_s) != self._second:
            self._second, self._packets = int(now_s), 0
        self._packets += 1
        return self._packets > _MOST_A_SECOND


class SealedReceiver:
    """Keeps one performer's newest sealed packet. Every method runs on the event loop."""

    def __init__(
        self, keep: Callable[[bytes], None], clock: Clock, send_body: Callable[[], None]
    ) -> None:
        """`keep` takes a packet to be passed on; `send_body` answers as for `MotionReceiver`."""
        self._keep, self._clock, self._send_body = keep, clock, send_body
        self._rate = _PacketRate()

    def receive(self, message: object) -> None:
        """Take a message off the channel; returns at once, whatever it holds."""
        if self._rate.exceeded(self._clock()):
            MOTIONS.labels("flood").inc()
            return
        if isinstance(message, str):
            self._send_body()
            return
        packet = message if isinstance(message, bytes) else b""
        try:
            require_sealed(packet)
        except PacketError as error:
            MOTIONS.labels("malformed").inc()
            log.debug("sealed packet dropped: %s", error)
            return
        self._keep(packet)
        MOTIONS.labels("sealed").inc()


class MotionReceiver:
    """Follows one performer's motion, as far as it is one. Every method runs on the event loop."""

    def __init__(
        self, motion: LiveMotion, clock: Clock, send_body: Callable[[], None] = lambda: None
    ) -> None:
        """`send_body` answers a page that asks whose poses it is to solve."""
        self._motion, self._clock, self._send_body = motion, clock, send_body
        self.on_live_look: Callable[[bool], None] = lambda _: None
        """Told of each packet, in order, whether it says that live look is on."""
        self._newest: int | None = None
        self._last: SolvedMotion | None = None
        self._rate = _PacketRate()

    def receive(self, message: object) -> None:
        """Take a message off the channel; returns at once, whatever it holds."""
        arrived_s = self._clock()
        if self._rate.exceeded(arrived_s):
            MOTIONS.labels("flood").inc()
            return
        if isinstance(message, str):
            self._send_body()
            return
        try:
            packet = decode_motion(message if isinstance(message, bytes) else b"")
        except PacketError as error:
            MOTIONS.labels("malformed").inc()
            log.debug("motion packet dropped: %s", error)
            return
        if self._newest is not None and not is_newer(packet.sequence, self._newest):
            MOTIONS.labels("late").inc()
            return
        self._newest = packet.sequence
        self.on_live_look(packet.live_look)
        try:
            require_plausible(packet.motion, self._last)
        except PacketError as error:
            MOTIONS.labels("implausible").inc()
            log.debug("motion packet dropped: %s", error)
            return
        self._last = packet.motion
        self._motion.follow(packet.motion, arrived_s)
        MOTIONS.labels("followed").inc()


class KeypointReceiver:
    """Solves one performer's packets; at most one waits, the newest."""

    def __init__(self, motion: LiveMotion, executor: Executor, clock: Clock) -> None:
        self._motion, self._executor, self._clock = motion, executor, clock
        self.on_live_look: Callable[[bool], None] = lambda _: None
        """Told of each packet, in order, whether it says that live look is on."""
        self._newest: int | None = None
        self._rate = _PacketRate()
        self._lock = threading.Lock()
        self._waiting: tuple[KeypointsPacket, float] | None = None
        self._solving = False

    def receive(self, message: object) -> None:
        """Take a message off the channel; returns at once, whatever it holds."""
        arrived_s = self._clock()
        if self._rate.exceeded(arrived_s):
            PACKETS.labels("flood").inc()
            return
        try:
            packet = decode_keypoints(message if isinstance(message, bytes) else b"")
        except PacketError as error:
            PACKETS.labels("malformed").inc()
            log.debug("keypoints packet dropped: %s", error)
            return
        if self._newest is not None and not is_newer(packet.sequence, self._newest):
            PACKETS.labels("late").inc()
            return
        self._newest = packet.sequence
        self.on_live_look(packet.live_look)
        with self._lock:
            if self._waiting is not None:
                PACKETS.labels("replaced").inc()
            self._waiting = packet, arrived_s
            idle, self._solving = not self._solving, True
        if idle:
            self._executor.submit(self._solve)

    def _solve(self) -> None:
        """On the solver's thread: one packet, then those of other performers."""
        with self._lock:
            waiting, self._waiting = self._waiting, None
        if waiting is not None:
            self._update(*waiting)
        with self._lock:
            self._solving = again = self._waiting is not None
        if again:
            self._executor.submit(self._solve)

    def _update(self, packet: KeypointsPacket, arrived_s: float) -> None:
        try:
            self._motion.update(packet, arrived_s)
        except InvalidInput as error:
            PACKETS.labels("no-person").inc()
            log.debug("no pose could be solved: %s", error)
        except Exception:
            # an error in the solver must not end the performer's motion
            log.exception("keypoints could not be solved")
        else:
            PACKETS.labels("solved").inc()
            TO_POSE_SECONDS.observe(self._clock() - arrived_s)
