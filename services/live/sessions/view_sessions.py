"""View sessions: one WebRTC connection a viewer, its video out, its viewpoint in."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Awaitable, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

from aiortc import (
    RTCConfiguration,
    RTCDataChannel,
    RTCIceServer,
    RTCPeerConnection,
    RTCRtpSender,
    RTCSessionDescription,
)
from aiortc.rtp import (
    RTCP_PSFB_APP,
    RTCP_PSFB_FIR,
    RTCP_PSFB_PLI,
    AnyRtcpPacket,
    RtcpPsfbPacket,
    RtcpRrPacket,
    RtcpRtpfbPacket,
    unpack_remb_fci,
)

from renderer.scene_renderer import warm_up
from scene.environment import Environment
from scene.errors import SceneError
from services.live.motion.keypoint_channels import Drivers
from services.live.packets import NewestView, PacketError, decode_view
from services.live.room import CastMember, Room
from services.live.streaming.encoding import PictureEncoder, chosen_codec
from services.live.streaming.pose_feed import PoseFeed, packets_of
from services.live.streaming.view_track import SharedPictures, ViewTrack
from services.seats import BEAT_S

log = logging.getLogger(__name__)

SILENCE_S = 5.0
"""A viewer silent for so long after their first viewpoint is gone (ICE consent needs 30 s)."""
CONNECT_S = 15.0
"""Time from the answer to a connection; who needs longer has gone away or can't get through."""

Clock = Callable[[], float]
LoadCast = Callable[[str], Awaitable[tuple[CastMember, ...]]]
"""Meeting id -> its performers."""
LoadEnvironment = Callable[[str], Awaitable[Environment]]
"""Meeting id -> the place it is held in."""


class Seats(Protocol):
    """Where it is noted which seats of meetings are taken; see services.seats."""

    async def keep(self, participant_ids: set[str]) -> None:
        """Somebody looks from these seats."""
        ...

    async def give_back(self, participant_ids: set[str]) -> None:
        """Nobody looks from these any more."""
        ...


class OfferRefused(SceneError):
    """The SDP offer can't be answered."""


class NoRoom(SceneError):
    """As many viewers as this server can serve are here already."""


@dataclass(eq=False)
class _Session:
    meeting_id: str
    connection: RTCPeerConnection
    track: ViewTrack
    opened_s: float
    participant_id: str | None
    """The seat that is looked from; none for who came without one."""
    account: str | None
    """Whose performers may be driven from here."""
    heard_s: float | None = None
    """When the last viewpoint came."""

    def is_gone(self, now_s: float) -> bool:
        """Whether nobody is there any more, as far as can be told."""
        if self.heard_s is not None:
            return now_s - self.heard_s > SILENCE_S
        return self.connection.connectionState != "connected" and now_s - self.opened_s > CONNECT_S


class ViewSessions:
    """All view sessions of this process. Every method runs on its event loop."""

    def __init__(
        self,
        load_cast: LoadCast,
        load_environment: LoadEnvironment,
        seats: Seats,
        clock: Clock,
        *,
        ice_servers: list[str],
        max_viewers: int,
        stamped: bool = False,
    ) -> None:
        """With `stamped`, pictures show when they were captured; see services.live.stamp."""
        self._load_cast, self._seats, self._clock = load_cast, seats, clock
        self._load_environment = load_environment
        self._ice = [RTCIceServer(urls=url) for url in ice_servers]
        self._max_viewers = max_viewers
        self._rooms: dict[str, Room] = {}
        self._pictures: dict[Room, SharedPictures] = {}
        self._stamped = stamped
        self._sessions: dict[str, _Session] = {}
        self._poses = PoseFeed(clock, stamped=stamped)
        self._drivers = Drivers(clock)
        # one thread renders for all: a picture already uses every core
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="render")
        self._warming: Future[None] | None = None
        self._watch: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        return len(self._sessions)

    def warm_up(self) -> None:
        """Have the renderer ready before the first viewer comes; returns at once."""
        self._warming = self._executor.submit(warm_up)
        self._warming.add_done_callback(_tell_failure)
        self._drivers.warm_up()

    @property
    def ready(self) -> bool:
        """Whether pictures come at once; on its first start on a machine the renderer compiles."""
        return self._warming is None or self._warming.done()

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
    ) -> tuple[str, str]:
        """Answer a viewer's offer. Returns the session's id and the SDP answer.

        Performers of `account` may be driven by a `keypoints` channel of this connection. The seat
        of `participant_id` is given back when the session ends, however it ends.
        Raises NoRoom when the server is full, OfferRefused for an SDP that can't be answered.
        """
        self._require_room()
        room = await self._room(meeting_id)
        self._require_room()  # others may have come while the performers were loaded
        connection = RTCPeerConnection(RTCConfiguration(iceServers=self._ice))
        view = NewestView()
        pictures = self._pictures.setdefault(room, SharedPictures(room, stamped=self._stamped))
        encoder = PictureEncoder(chosen_codec(sdp_offer))
        track = ViewTrack(pictures, view, encoder, self._executor, self._clock)
        session = _Session(meeting_id, connection, track, self._clock(), participant_id, account)
        session_id = secrets.token_urlsafe(12)
        self._sessions[session_id] = session
        self._listen(session_id, session, room, view)
        try:
            answer = await _answer(connection, track, sdp_offer)
        except Exception as error:
            await self.close(session_id)
            reason = str(error) or type(error).__name__
            raise OfferRefused(
                f"the offer must be an SDP that asks for one H.264 or VP8 video; got an offer that "
                f"fails with: {reason}"
            ) from error
        if self._watch is None:
            self._watch = asyncio.create_task(self._keep_watch())
        return session_id, answer

    def find(self, session_id: str) -> _Session | None:
        """A running session."""
        return self._sessions.get(session_id)

    async def close(self, session_id: str) -> bool:
        """End a session; False when there is none of that id."""
        session = self._sessions.pop(session_id, None)
        if session is None:
            return False
        session.track.stop()
        await session.connection.close()
        seat = session.participant_id
        if seat is not None and seat not in self._seats_taken():
            await self._seats.give_back({seat})
        if not any(s.meeting_id == session.meeting_id for s in self._sessions.values()):
            room = self._rooms.pop(session.meeting_id, None)
            if room is not None:
                self._pictures.pop(room, None)
        return True

    def looked_into(self, meeting_id: str) -> bool:
        """Whether anybody looks into a meeting."""
        return any(session.meeting_id == meeting_id for session in self._sessions.values())

    def poses(self, meeting_id: str) -> list[tuple[str, bytes]]:
        """How the performers of a meeting stand now, as pose packets, by performer.

        None of a meeting into which nobody looks.
        """
        room = self._rooms.get(meeting_id)
        if room is None:
            return []
        packets = packets_of(room, self._clock(), 0)
        return [(one.performer_id, data) for one, data in zip(room.cast, packets, strict=True)]

    async def keep_only(self, meeting_id: str, may_look: Callable[[str | None], bool]) -> None:
        """End the sessions in a meeting of those who may look no more; asked with their seat."""
        for session_id, session in list(self._sessions.items()):
            if session.meeting_id == meeting_id and not may_look(session.participant_id):
                await self.close(session_id)

    async def refresh(self, meeting_id: str) -> None:
        """Show a change of the cast or of the place to everyone who looks."""
        if meeting_id in self._rooms:
            room = self._rooms[meeting_id]
            room.cast = await self._load_cast(meeting_id)
            room.environment = await self._load_environment(meeting_id)

    async def close_all(self) -> None:
        """End every session, at shutdown."""
        if self._watch is not None:
            self._watch.cancel()
        await asyncio.gather(*(self.close(session_id) for session_id in list(self._sessions)))
        self._executor.shutdown(wait=False)
        self._drivers.close()

    async def _room(self, meeting_id: str) -> Room:
        if meeting_id not in self._rooms:
            cast = await self._load_cast(meeting_id)
            environment = await self._load_environment(meeting_id)
            # of two who come at once, both look into one room
            self._rooms.setdefault(meeting_id, Room(meeting_id, cast, environment))
        return self._rooms[meeting_id]

    def _require_room(self) -> None:
        if len(self._sessions) >= self._max_viewers:
            raise NoRoom(
                f"at most {self._max_viewers} viewers fit on this server; got one more; try again"
            )

    def _seats_taken(self) -> set[str]:
        seats = (session.participant_id for session in self._sessions.values())
        return {seat for seat in seats if seat is not None}

    def _listen(self, session_id: str, session: _Session, room: Room, view: NewestView) -> None:
        connection = session.connection

        @connection.on("datachannel")
        def on_channel(channel: RTCDataChannel) -> None:
            if channel.label == "pose":
                self._poses.add(room, view, channel)
            if channel.label == "keypoints":
                self._drivers.add(room, session.account, channel)
            if channel.label != "view":
                return

            @channel.on("message")
            def on_message(message: object) -> None:
                session.heard_s = self._clock()
                try:
                    view.offer(decode_view(message if isinstance(message, bytes) else b""))
                except PacketError as error:
                    log.debug("view packet dropped: %s", error)

        @connection.on("connectionstatechange")
        async def on_state() -> None:
            if connection.connectionState in ("failed", "closed"):
                await self.close(session_id)

    async def _keep_watch(self) -> None:
        """Once a second end the sessions of those who are gone; now and then keep seats."""
        kept_s = self._clock()
        while True:
            await asyncio.sleep(1.0)
            now_s = self._clock()
            for session_id, session in list(self._sessions.items()):
                if session.is_gone(now_s):
                    await self.close(session_id)
            if now_s - kept_s >= BEAT_S:
                kept_s = now_s
                await self._seats.keep(self._seats_taken())


def _tell_failure(warming: Future[None]) -> None:
    if not warming.cancelled() and (error := warming.exception()):
        log.error("the renderer could not be made ready", exc_info=error)


async def _answer(connection: RTCPeerConnection, track: ViewTrack, sdp_offer: str) -> str:
    transceiver = connection.addTransceiver(track, direction="sendonly")
    codec = chosen_codec(sdp_offer)
    codecs = RTCRtpSender.getCapabilities("video").codecs
    # preferences count only before the remote description is set
    wanted = (f"video/{codec}", "video/rtx")
    transceiver.setCodecPreferences([c for c in codecs if c.mimeType in wanted])
    _heed(transceiver.sender, track)
    await connection.setRemoteDescription(RTCSessionDescription(sdp_offer, "offer"))
    await connection.setLocalDescription(await connection.createAnswer())
    return connection.localDescription.sdp


def _heed(sender: RTCRtpSender, track: ViewTrack) -> None:
    """Tell `track` what its viewer asks for: key frames (PLI, FIR), a bitrate (REMB), losses.

    aiortc tells its own encoders alone, and these are not used: packets come from the track. And it
    sends again whatever is asked for (NACK), many times what a slow line carries.
    """
    handle = sender._handle_rtcp_packet

    async def listen(packet: AnyRtcpPacket) -> None:
        heed_feedback(packet, track, sender._ssrc)
        await handle(packet)

    sender._handle_rtcp_packet = listen


def heed_feedback(packet: AnyRtcpPacket, track: ViewTrack, ssrc: int) -> None:
    """Act on one message about the stream `ssrc`; a NACK keeps what is worth sending again.

    Feedback is RFC 4585 (REMB: draft-alvestrand-rmcat), receiver reports are RFC 3550.
    """
    if isinstance(packet, RtcpRtpfbPacket):
        packet.lost = track.worth_resending(packet.lost)
    elif isinstance(packet, RtcpRrPacket) and track.wanted:
        for report in packet.reports:
            if report.ssrc == ssrc:
                track.bitrate.loss(report.fraction_lost / 256)
    elif isinstance(packet, RtcpPsfbPacket):
        _heed_picture_feedback(packet, track)


def _heed_picture_feedback(packet: RtcpPsfbPacket, track: ViewTrack) -> None:
    if packet.fmt in (RTCP_PSFB_PLI, RTCP_PSFB_FIR):
        track.ask_key_frame()
    elif packet.fmt == RTCP_PSFB_APP:
        try:
            bitrate, _ = unpack_remb_fci(packet.fci)
        except ValueError:
            return  # another application's message
        track.bitrate.estimate(bitrate)
