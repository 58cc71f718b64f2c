"""View sessions: one WebRTC connection per viewer, its video out, its viewpoint in."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections import Counter
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from typing import Protocol

from aiortc import (
    RTCConfiguration,
    RTCDataChannel,
    RTCIceServer,
    RTCPeerConnection,
)

from scene.environment import Environment
from services.errors import OfferRefused, ServerFull, TooManyRequests
from services.live.aiortc_compat import on_encoded_frame, on_rtcp_packet, request_key_frame
from services.live.look.keeping import Keeping
from services.live.look.receiver import LookReceiver, offers_pictures
from services.live.motion.driving_channels import (
    DescribeError,
    DrivingChannels,
    MakeLookSink,
    OnRefusal,
    drop_pictures,
)
from services.live.packets import NewestView, PacketError, decode_view
from services.live.room import MeetingPerformer, Room
from services.live.sessions import view_offer
from services.live.sessions.view_session import ViewChannel, ViewSession
from services.live.streaming.encoding import Codec, negotiated_codec
from services.live.streaming.instrumentation import Instrumentation
from services.live.streaming.look_feed import LookFeed
from services.live.streaming.pictures import Renderers
from services.live.streaming.pose_feed import PoseFeed, pose_packets
from services.live.streaming.rtcp_feedback import apply_feedback
from services.live.streaming.view_track import ViewTrack
from services.seats import BEAT_S

log = logging.getLogger(__name__)

_MOST_OF_A_SEAT = 3
"""Sessions: a page that is loaded again leaves one behind, until its silence is noticed."""
_MOST_OF_AN_ONLOOKER = 3
"""Sessions of one who has no seat."""
_RETRY_S = 10
"""In which a session that somebody left behind is noticed."""

Clock = Callable[[], float]


class MeetingSource(Protocol):
    """Where meetings are stored; see services.live.sessions.stored_meetings."""

    async def performers(self, meeting_id: str) -> tuple[MeetingPerformer, ...]:
        """The performers of a meeting. Raises NotFound."""
        ...

    async def environment(self, meeting_id: str) -> Environment:
        """The environment that a meeting is held in. Raises NotFound."""
        ...

    async def sealed(self, meeting_id: str) -> bool:
        """Whether motion in a meeting is encrypted. Raises NotFound."""
        ...

    async def renew_seats(self, participant_ids: set[str]) -> None:
        """Note that these seats are in use."""
        ...

    async def release_seats(self, participant_ids: set[str]) -> None:
        """Note that these seats are free."""
        ...


class ViewSessions:
    """All view sessions of this process. Every method runs on its event loop."""

    def __init__(
        self,
        meetings: MeetingSource,
        clock: Clock,
        renderers: Renderers,
        *,
        ice_servers: list[str],
        max_viewers: int,
        describe_error: DescribeError,
        instrumentation: Instrumentation | None = None,
        make_look_sink: MakeLookSink = drop_pictures,
        on_refusal: OnRefusal = lambda *_: None,
    ) -> None:
        """`renderers` are closed with the sessions; `describe_error` words why a keypoint channel
        is closed; `instrumentation` is called for all that is sent to viewers; `make_look_sink`
        gives what takes pictures of a performer; `on_refusal` is told who may not drive."""
        self._meetings, self._clock, self._renderers = meetings, clock, renderers
        self._ice_servers = [RTCIceServer(urls=url) for url in ice_servers]
        self._max_viewers = max_viewers
        self._instrumentation = instrumentation or Instrumentation()
        self._rooms: dict[str, Room] = {}
        self._sessions: dict[str, ViewSession] = {}
        self._arriving: Counter[str] = Counter()
        """Seats that somebody asks for a session from; see `arriving`."""
        self._left: set[str] = set()
        """Of these, whose sessions have ended meanwhile."""
        self._pose_feed = PoseFeed(clock, self._instrumentation)
        self._look_feed = LookFeed()
        self.driving_channels = DrivingChannels(
            clock, describe_error, make_look_sink, self._look_feed.relay, on_refusal
        )
        # one waits for its pictures without holding up another
        self._look_executor = ThreadPoolExecutor(max(1, max_viewers), thread_name_prefix="look")
        self._monitoring: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        return len(self._sessions)

    @property
    def meetings(self) -> int:
        """How many are watched here."""
        return len({session.meeting_id for session in self._sessions.values()})

    def warm_up(self) -> None:
        """Prepare what draws before the first viewer comes; returns at once."""
        self._renderers.warm_up()
        self.driving_channels.warm_up()

    @property
    def ready(self) -> bool:
        """Whether pictures come at once."""
        return self._renderers.ready

    def render_milliseconds(self) -> list[float]:
        """Times of the latest renders of all sessions, ms."""
        return [
            1e3 * s for session in self._sessions.values() for s in session.track.render_seconds
        ]

    async def open(
        self,
        meeting_id: str,
        sdp_offer: str,
        participant_id: str | None = None,
        account: str | None = None,
        *,
        onlooker: str | None = None,
    ) -> tuple[str, str]:
        """Answer a viewer's SDP offer. Returns the session's id and the SDP answer.

        Performers of `account`, and those that are lent, may be driven by a `keypoints` channel of
        this connection. The seat of `participant_id` is released when the session ends, however it
        ends; of several sessions the newest few stay. `onlooker` tells those without a seat apart,
        of whom each has a few sessions. Raises ServerFull where there are too many viewers,
        TooManyRequests where there are too many of an onlooker, OfferRefused for an SDP that can't
        be answered, MeetingSealed for one that asks for pictures where nothing can be drawn.
        """
        self._require_capacity(onlooker)
        room = await self.room(meeting_id)
        if room.sealed:
            view_offer.require_no_media(sdp_offer)
        await self._end_older(participant_id)
        # others may have come while the performers were loaded
        self._require_capacity(onlooker)
        pictures = self._renderers.open(room, negotiated_codec(sdp_offer))
        connection = RTCPeerConnection(RTCConfiguration(iceServers=self._ice_servers))
        view = NewestView()
        track = ViewTrack(room, pictures, view, self._instrumentation, self._clock)
        session = ViewSession(
            meeting_id, connection, track, self._clock(), participant_id, account, onlooker
        )
        session_id = secrets.token_urlsafe(12)
        self._sessions[session_id] = session
        self._listen(session_id, session, room, view)
        try:
            view_offer.require_few_sections(sdp_offer)
            if not room.sealed:
                self._add_transceivers(session, sdp_offer)
            answer = await view_offer.answer(connection, sdp_offer)
        except Exception as error:
            await self.close(session_id)
            reason = str(error) or type(error).__name__
            raise OfferRefused(
                f"the offer must be an SDP that asks for one H.264 or VP8 video; got an offer that "
                f"fails with: {reason}"
            ) from error
        if self._monitoring is None:
            self._monitoring = asyncio.create_task(self._monitor())
        return session_id, answer

    def find(self, session_id: str) -> ViewSession | None:
        """A running session."""
        return self._sessions.get(session_id)

    def kept_of(self, session: ViewSession) -> tuple[MeetingPerformer, Keeping] | None:
        """Whom a session drives, and what is kept of their pictures; None where nothing can be."""
        room = self._rooms.get(session.meeting_id)
        keeping = None if session.look is None else session.look.keeping
        for performer in () if room is None or keeping is None else room.performers:
            sink = room.looks.get(performer.performer_id) if room else None
            if keeping is not None and sink is not None and sink.keeping is keeping:
                return performer, keeping
        return None

    async def close(self, session_id: str) -> bool:
        """End a session, and release its seat; False where there is none of that id."""
        session = self._sessions.pop(session_id, None)
        if session is None:
            return False
        await self._end(session)
        if session.participant_id is not None:
            await self._leave(session.participant_id)
        return True

    @asynccontextmanager
    async def arriving(self, participant_id: str | None) -> AsyncIterator[None]:
        """From the look at a seat until a session has it: one that ends meanwhile releases it not
        before the end of this, and only if none has come."""
        if participant_id is None:
            yield
            return
        self._arriving[participant_id] += 1
        try:
            yield
        finally:
            self._arriving -= Counter((participant_id,))
            if participant_id in self._left and participant_id not in self._arriving:
                self._left.discard(participant_id)
                await self._leave(participant_id)

    async def _leave(self, seat: str) -> None:
        """Of a session that has ended."""
        if seat in self._arriving:
            self._left.add(seat)
        elif seat not in self._seats_in_use():
            await self._meetings.release_seats({seat})

    async def send_away(self, meeting_id: str) -> None:
        """End all sessions in a meeting, whose viewers go on elsewhere: their seats stay theirs
        until they lapse."""
        for session_id, session in list(self._sessions.items()):
            if session.meeting_id == meeting_id:
                del self._sessions[session_id]
                await self._end(session)

    async def _end_older(self, participant_id: str | None) -> None:
        """So that nobody takes all places by one seat."""
        theirs = [
            session_id
            for session_id, one in self._sessions.items()
            if participant_id is not None and one.participant_id == participant_id
        ]
        for session_id in theirs[: max(0, len(theirs) + 1 - _MOST_OF_A_SEAT)]:
            await self._end(self._sessions.pop(session_id))

    async def _end(self, session: ViewSession) -> None:
        """Of a session that is no longer among those of this process."""
        session.track.stop()
        if session.look is not None:
            session.look.close()
        await session.connection.close()
        if not self.is_watched(session.meeting_id):
            self._rooms.pop(session.meeting_id, None)

    async def room(self, meeting_id: str) -> Room:
        """The live state of a meeting; loaded where nobody watches it yet. Raises NotFound."""
        if meeting_id not in self._rooms:
            performers = await self._meetings.performers(meeting_id)
            environment = await self._meetings.environment(meeting_id)
            sealed = await self._meetings.sealed(meeting_id)
            # two viewers who come at once share a room
            self._rooms.setdefault(
                meeting_id, Room(meeting_id, performers, environment, sealed=sealed)
            )
        return self._rooms[meeting_id]

    def is_watched(self, meeting_id: str) -> bool:
        """Whether a meeting has any viewer."""
        return any(session.meeting_id == meeting_id for session in self._sessions.values())

    def pose_packets(self, meeting_id: str) -> list[tuple[str, bytes]]:
        """The performers' poses now, as pose packets, by performer.

        None of a meeting without viewers.
        """
        room = self._rooms.get(meeting_id)
        if room is None:
            return []
        packets = pose_packets(room, self._clock(), 0)
        return [
            (one.performer_id, data) for one, data in zip(room.performers, packets, strict=True)
        ]

    async def close_unless(self, meeting_id: str, may_watch: Callable[[str | None], bool]) -> None:
        """End the sessions in a meeting of participants for whom `may_watch` is False.

        It is given the participant's id, or None for a viewer without a seat.
        """
        for session_id, session in list(self._sessions.items()):
            if session.meeting_id == meeting_id and not may_watch(session.participant_id):
                await self.close(session_id)

    async def refresh(self, meeting_id: str) -> None:
        """Show a change of the performers or of the environment to every viewer."""
        if meeting_id in self._rooms:
            room = self._rooms[meeting_id]
            room.performers = await self._meetings.performers(meeting_id)
            room.environment = await self._meetings.environment(meeting_id)
            self.driving_channels.close_refused(room)

    async def close_all(self) -> None:
        """End every session, at shutdown."""
        if self._monitoring is not None:
            self._monitoring.cancel()
            await asyncio.wait([self._monitoring])
        await asyncio.gather(*(self.close(session_id) for session_id in list(self._sessions)))
        await self._pose_feed.close()
        await self._renderers.close()
        self._look_executor.shutdown(wait=False)
        self.driving_channels.close()

    def _require_capacity(self, onlooker: str | None) -> None:
        theirs = [one for one in self._sessions.values() if one.onlooker == onlooker]
        if onlooker is not None and len(theirs) >= _MOST_OF_AN_ONLOOKER:
            raise TooManyRequests(
                f"views without a seat must be at most {_MOST_OF_AN_ONLOOKER} at once of one "
                f"caller; got one more; end another, join, or come back in {_RETRY_S} s",
                _RETRY_S,
            )
        if len(self._sessions) >= self._max_viewers:
            raise ServerFull(
                f"at most {self._max_viewers} viewers fit on this server; got one more; try again"
            )

    def _seats_in_use(self) -> set[str]:
        seats = (session.participant_id for session in self._sessions.values())
        return {seat for seat in seats if seat is not None}

    def _listen(self, session_id: str, session: ViewSession, room: Room, view: NewestView) -> None:
        connection = session.connection

        @connection.on("datachannel")
        def on_channel(channel: RTCDataChannel) -> None:
            if channel.label not in set(ViewChannel):
                return
            match ViewChannel(channel.label):
                case ViewChannel.VIEW:
                    channel.on("message", follow_view)
                case ViewChannel.POSE:
                    session.feed_by(channel)
                    self._pose_feed.add(room, view, channel)
                case ViewChannel.LOOK:
                    session.feed_by(channel)
                    self._look_feed.add(room, view, channel)
                case ViewChannel.MOTION | ViewChannel.KEYPOINTS:
                    self.driving_channels.add(room, session.account, channel, session.look)

        def follow_view(message: object) -> None:
            session.last_message_s = self._clock()
            try:
                view.receive(decode_view(message if isinstance(message, bytes) else b""))
            except PacketError as error:
                log.debug("view packet dropped: %s", error)

        @connection.on("connectionstatechange")
        async def on_state() -> None:
            if connection.connectionState in ("failed", "closed"):
                await self.close(session_id)

    def _add_transceivers(self, session: ViewSession, sdp_offer: str) -> None:
        """The server's side of the offer's video sections, in their order."""
        connection, track = session.connection, session.track
        sending = connection.addTransceiver(track, direction="sendonly")
        view_offer.prefer(sending, negotiated_codec(sdp_offer))
        # packets come from the track, so feedback has to reach it and not aiortc's own encoder
        on_rtcp_packet(sending.sender, lambda packet, ssrc: apply_feedback(packet, track, ssrc))
        if not offers_pictures(sdp_offer):
            return
        receiving = connection.addTransceiver("video", direction="recvonly")
        view_offer.prefer(receiving, Codec.VP8)
        receiver = receiving.receiver
        look = session.look = LookReceiver(self._look_executor, lambda: request_key_frame(receiver))
        on_encoded_frame(receiver, lambda data, _: look.on_frame(data))

    async def _monitor(self) -> None:
        """Once a second end the sessions of viewers who have left; now and then renew seats."""
        renewed_s = self._clock()
        while True:
            await asyncio.sleep(1.0)
            now_s = self._clock()
            for session_id, session in list(self._sessions.items()):
                if session.has_left(now_s):
                    await self.close(session_id)
            if now_s - renewed_s >= BEAT_S:
                renewed_s = now_s
                await self._meetings.renew_seats(self._seats_in_use())
