"""Keypoints channels: a participant's landmarks come in, their performer moves.

A page opens the data channel `keypoints` with the performer's id as its protocol. Only a performer
of the caller's own account may be driven, by one channel at a time: a newer one takes over, so that
a reload is no obstacle. Who is refused is told by a problem (RFC 9457) before the channel closes.
Packets are read on the event loop and solved on a thread of their own; of each performer only the
newest waits.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor

from aiortc import RTCDataChannel
from prometheus_client import Counter, Gauge, Histogram

from scene.errors import InvalidInput
from services.auth import GUEST, is_guest
from services.live.motion.live_motion import LiveMotion, warm_up
from services.live.packets import KeypointsPacket, PacketError, decode_keypoints, is_newer
from services.live.room import CastMember, Room, facing_yaw
from services.problems import ProblemError

log = logging.getLogger(__name__)

PACKETS = Counter(
    "metanerf_keypoints_total", "Keypoints packets, by what became of them.", ["outcome"]
)
"""solved; malformed; late (a newer one was here); replaced (by a newer one, while it waited);
no-person (nothing in it tells a pose)."""
TO_POSE_SECONDS = Histogram(
    "metanerf_keypoints_to_pose_seconds",
    "Time from a packet's coming to its pose, s.",
    buckets=(0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5),
)
DRIVEN = Gauge("metanerf_driven_performers", "Performers driven live now.")

Clock = Callable[[], float]


class Drivers:
    """All keypoints channels of this process. Every method runs on its event loop."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        # one thread for all: a pose takes milliseconds, and a packet that waits is replaced
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="solve")
        self._channels: dict[tuple[Room, str], RTCDataChannel] = {}

    def add(self, room: Room, account: str | None, channel: RTCDataChannel) -> None:
        """Let `channel` drive the performer of `room` that it names, if `account` may."""
        try:
            member = _own_member(room, account, channel.protocol)
        except ProblemError as refusal:
            _refuse(channel, refusal)
            return
        key = (room, member.performer_id)
        if (before := self._channels.get(key)) is not None:
            _refuse(before, _TAKEN_OVER)
        motion = LiveMotion(member.model.skeleton, -facing_yaw(member.motion))
        inbox = Inbox(motion, self._executor, self._clock)
        self._channels[key] = channel
        room.live[member.performer_id] = motion
        DRIVEN.set(len(self._channels))
        channel.on("message", inbox.offer)
        channel.on("close", lambda: self._drop(key, channel))

    def warm_up(self) -> None:
        """Have the solver ready before the first packet comes; returns at once."""
        self._executor.submit(warm_up)

    def close(self) -> None:
        """Let go of the thread."""
        self._executor.shutdown(wait=False, cancel_futures=True)

    def _drop(self, key: tuple[Room, str], channel: RTCDataChannel) -> None:
        room, performer_id = key
        if self._channels.get(key) is channel:
            del self._channels[key]
            room.live.pop(performer_id, None)
        DRIVEN.set(len(self._channels))


class Inbox:
    """One performer's packets: the newest waits, at most one."""

    def __init__(self, motion: LiveMotion, executor: Executor, clock: Clock) -> None:
        self._motion, self._executor, self._clock = motion, executor, clock
        self._newest: int | None = None
        self._guard = threading.Lock()
        self._waiting: tuple[KeypointsPacket, float] | None = None
        self._solving = False

    def offer(self, message: object) -> None:
        """Take a message off the channel; returns at once, whatever it holds."""
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
        with self._guard:
            if self._waiting is not None:
                PACKETS.labels("replaced").inc()
            self._waiting = packet, self._clock()
            idle, self._solving = not self._solving, True
        if idle:
            self._executor.submit(self._solve)

    def _solve(self) -> None:
        """On the solver's thread: one packet, then let other performers have their turn."""
        with self._guard:
            waiting, self._waiting = self._waiting, None
        if waiting is not None:
            self._move(*waiting)
        with self._guard:
            self._solving = again = self._waiting is not None
        if again:
            self._executor.submit(self._solve)

    def _move(self, packet: KeypointsPacket, arrived_s: float) -> None:
        try:
            self._motion.follow(packet, arrived_s)
        except InvalidInput as error:
            PACKETS.labels("no-person").inc()
            log.debug("keypoints tell no pose: %s", error)
        except Exception:
            # a fault of ours must not end the performer's motion for good
            log.exception("keypoints could not be solved")
        else:
            PACKETS.labels("solved").inc()
            TO_POSE_SECONDS.observe(self._clock() - arrived_s)


_TAKEN_OVER = ProblemError(
    409,
    "driven-elsewhere",
    "a performer must be driven from one place at a time; got a newer one; close the other page "
    "or switch the camera on here again",
)


def _own_member(room: Room, account: str | None, performer_id: str) -> CastMember:
    """The performer of this id, if it is of `account`. Raises a 404 or 403 problem."""
    for member in room.cast:
        if member.performer_id != performer_id:
            continue
        # the demo's own performer, which is nobody's, moves for whichever guest comes
        lent = member.account == GUEST and is_guest(account or "")
        if account is None or not (member.account == account or lent):
            raise ProblemError(
                403,
                "not-yours",
                f"the token must be of the account whose person is driven; got one of {account!r}; "
                "bring somebody of your own into the meeting",
            )
        return member
    raise ProblemError(
        404,
        "not-found",
        "protocol of the channel must be the id of a performer of this meeting; got "
        f"{performer_id!r}; read the meeting to see who is there",
    )


def _refuse(channel: RTCDataChannel, refusal: ProblemError) -> None:
    if channel.readyState == "open":  # one that is closing has nobody to tell
        channel.send(refusal.problem.model_dump_json())
        channel.close()
