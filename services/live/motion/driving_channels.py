"""Driving channels: a participant's motion comes in, their performer moves.

A page opens the data channel `motion`, over which it sends the poses that it has solved; whoever
cannot solve opens `keypoints` and sends landmarks, which are solved here. Either has the
performer's id as its protocol. Only a performer
of the caller's own account may be driven, or one whose person consents to being driven by others;
by one channel at a time: a newer one takes over, so that a page may be reloaded, but nobody takes
over from the owner. A channel that is refused is sent a problem (RFC 9457) before it closes.
Where the connection also brings pictures for live look, they are of the performer, if the performer
is the caller's own.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

from aiortc import RTCDataChannel
from prometheus_client import Gauge

from db.errors import NotFound
from services.auth import GUEST, INVITED
from services.errors import DrivenElsewhere, MeetingSealed, NotInMeeting, NotOwner
from services.likeness import may_drive
from services.live.look.picture import DroppedPictures, LookSink
from services.live.look.receiver import LookReceiver
from services.live.look.relay import LookRelay, NoRelay
from services.live.motion.body_packet import encode_body
from services.live.motion.live_motion import LiveMotion, warm_up
from services.live.motion.receivers import KeypointReceiver, MotionReceiver, SealedReceiver
from services.live.room import MeetingPerformer, Room, facing_yaw

MOTION, KEYPOINTS = "motion", "keypoints"
"""Labels of the channels that drive."""
DRIVEN = Gauge("metanerf_driven_performers", "Performers driven live now.")

Clock = Callable[[], float]
DescribeError = Callable[[Exception], str]
"""An error as the JSON text of a problem (RFC 9457)."""
MakeLookSink = Callable[[MeetingPerformer, LiveMotion], LookSink]
"""What shows a performer, who moves so, as they look now."""
MakeLookRelay = Callable[[Room, str], LookRelay]
"""What passes the pictures of a performer of a room on to pages that draw."""
OnRefusal = Callable[[str, str, str, Exception], None]
"""Told of who is refused, by what tells callers apart and by account, where, and why."""


def drop_pictures(performer: MeetingPerformer, motion: LiveMotion) -> LookSink:
    """A sink for a renderer that has no use for pictures."""
    return DroppedPictures()


@dataclass(frozen=True, eq=False)
class _Driver:
    """What drives one performer."""

    account: str | None
    channel: RTCDataChannel
    look: LookReceiver | None
    sink: LookSink | None

    def drop_kept(self) -> None:
        """Nothing is kept of its pictures."""
        if self.sink is not None and self.sink.keeping is not None:
            self.sink.keeping.drop()

    def stop(self) -> None:
        """No picture of this connection is shown any more, nor kept."""
        if self.look is not None and self.sink is not None:
            self.look.detach(self.sink)


class DrivingChannels:
    """All driving channels of this process. Every method runs on its event loop."""

    def __init__(
        self,
        clock: Clock,
        describe_error: DescribeError,
        make_look_sink: MakeLookSink = drop_pictures,
        make_look_relay: MakeLookRelay = lambda *_: NoRelay(),
        on_refusal: OnRefusal = lambda *_: None,
    ) -> None:
        self._clock, self._describe_error = clock, describe_error
        self.make_look_sink, self._make_look_relay = make_look_sink, make_look_relay
        self._on_refusal = on_refusal
        # one thread for all: a pose takes milliseconds, and a packet that waits is replaced
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="solve")
        self._drivers: dict[tuple[Room, str], _Driver] = {}

    def add(
        self,
        room: Room,
        account: str | None,
        channel: RTCDataChannel,
        look: LookReceiver | None = None,
    ) -> None:
        """Have `channel` drive the performer of `room` that it names, if `account` may.

        Pictures that come by `look` are of that performer, if `account` owns them. In a sealed room
        packets are passed on unread.
        """
        try:
            if room.sealed and channel.label != MOTION:
                raise MeetingSealed(_LANDMARKS_SEALED)
            performer = drivable_performer(room, account, channel.protocol)
            key = (room, performer.performer_id)
            before = self._drivers.get(key)
            if before is not None and _owner_goes_on(performer, before.account, account):
                raise DrivenElsewhere(_OWNER_DRIVES)
        except (NotFound, NotOwner, DrivenElsewhere, MeetingSealed) as refusal:
            self._reject(channel, refusal)
            self._on_refusal(account or "", account or "", f"channel {channel.label}", refusal)
            return
        if before is not None:
            before.stop()
            self._reject(before.channel, DrivenElsewhere(_TAKEN_OVER))
        connect = self._relay if room.sealed else self._follow
        driver = self._drivers[key] = connect(room, performer, account, channel, look)
        DRIVEN.set(len(self._drivers))
        channel.on("close", lambda: self._remove(key, driver))

    def close_refused(self, room: Room) -> None:
        """Close the channels of whoever may not drive in `room` any more: their performer is gone,
        or lent no longer. Pictures of who does not consent to learning from them are dropped."""
        for key, driver in list(self._drivers.items()):
            if key[0] is not room:
                continue
            try:
                performer = drivable_performer(room, driver.account, key[1])
                if not performer.learns:
                    driver.drop_kept()
            except NotFound:
                self._reject(driver.channel, NotInMeeting(_SHOWN_NO_LONGER))
                self._remove(key, driver)
            except NotOwner as refusal:
                self._reject(driver.channel, refusal)
                self._remove(key, driver)

    def warm_up(self) -> None:
        """Prepare the solver before the first packet comes; returns at once."""
        self._executor.submit(warm_up)

    def close(self) -> None:
        """Stop the thread."""
        self._executor.shutdown(wait=False, cancel_futures=True)

    def _relay(
        self,
        room: Room,
        performer: MeetingPerformer,
        account: str | None,
        channel: RTCDataChannel,
        _: LookReceiver | None,
    ) -> _Driver:
        """Keep what comes, unread, for the room's viewers."""
        keep = partial(room.sealed_motions.__setitem__, performer.performer_id)
        receiver = SealedReceiver(keep, self._clock, partial(_send_body, channel, performer))
        channel.on("message", receiver.receive)
        return _Driver(account, channel, None, None)

    def _follow(
        self,
        room: Room,
        performer: MeetingPerformer,
        account: str | None,
        channel: RTCDataChannel,
        look: LookReceiver | None,
    ) -> _Driver:
        """Have the performer move as what comes says."""
        motion = LiveMotion(performer.model.skeleton, -facing_yaw(performer.motion))
        receiver: MotionReceiver | KeypointReceiver
        if channel.label == MOTION:
            send_body = partial(_send_body, channel, performer)
            receiver = MotionReceiver(motion, self._clock, send_body)
        else:
            receiver = KeypointReceiver(motion, self._executor, self._clock)
        sink = None
        if look is not None and owns_alone(account, performer):
            sink = room.looks[performer.performer_id] = self.make_look_sink(performer, motion)
            look.attach(sink, self._make_look_relay(room, performer.performer_id))
            receiver.on_live_look = look.announce
        room.live_motions[performer.performer_id] = motion
        channel.on("message", receiver.receive)
        return _Driver(account, channel, look, sink)

    def _reject(self, channel: RTCDataChannel, refusal: Exception) -> None:
        _send(channel, self._describe_error(refusal))
        channel.close()

    def _remove(self, key: tuple[Room, str], driver: _Driver) -> None:
        room, performer_id = key
        if self._drivers.get(key) is driver:
            driver.stop()
            del self._drivers[key]
            room.live_motions.pop(performer_id, None)
            room.looks.pop(performer_id, None)
            room.sealed_motions.pop(performer_id, None)
        DRIVEN.set(len(self._drivers))


def _send(channel: RTCDataChannel, message: str | bytes) -> None:
    if channel.readyState == "open":  # nobody reads from one that is closing
        channel.send(message)


def _send_body(channel: RTCDataChannel, performer: MeetingPerformer) -> None:
    _send(channel, encode_body(performer.model.skeleton, -facing_yaw(performer.motion)))


_TAKEN_OVER = (
    "a performer must be driven from one place at a time; got a newer one; close the other page "
    "or switch the camera on here again",
)
_SHOWN_NO_LONGER = (
    "whoever is driven must be shown in the meeting; got a performer who is shown no longer: their "
    "consent has ended, or they were taken out; see Your consent under More"
)
_LANDMARKS_SEALED = (
    "a page in a sealed meeting must solve poses itself and seal them, on the channel motion; got "
    "landmarks, which this server would have to read; use the page, with the whole link"
)
_OWNER_DRIVES = (
    "a performer must be driven from one place at a time; got another one while the owner drives; "
    "wait until they stop"
)


def _owner_goes_on(performer: MeetingPerformer, before: str | None, account: str | None) -> bool:
    """Whether the owner drives already, and somebody else asks."""
    return before == performer.account and account != before


def owns_alone(account: str | None, performer: MeetingPerformer) -> bool:
    """Whether a performer is of this account, and it of one person: many come as `INVITED`."""
    return performer.account == account and account not in (None, "", GUEST, INVITED)


def drivable_performer(room: Room, account: str | None, performer_id: str) -> MeetingPerformer:
    """The performer of this id, if `account` may drive it. Raises NotFound, NotOwner."""
    for performer in room.performers:
        if performer.performer_id != performer_id:
            continue
        if not may_drive(account, performer.account, lent=performer.lent):
            raise NotOwner(
                f"the token must be of the account whose person is driven; got one of {account!r}; "
                "bring somebody of your own into the meeting, or ask the owner for their consent",
            )
        return performer
    raise NotFound(
        "protocol of the channel must be the id of a performer of this meeting; got "
        f"{performer_id!r}; read the meeting to see who is shown there",
    )
