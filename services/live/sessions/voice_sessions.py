"""The WebRTC connections that carry voices and shared screens, and what each forwards to others."""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any

from aiortc import (
    RTCBundlePolicy,
    RTCConfiguration,
    RTCIceServer,
    RTCPeerConnection,
    RTCRtpReceiver,
    RTCRtpSender,
    RTCRtpTransceiver,
    RTCSessionDescription,
)

from services.errors import NotPresenting, OfferRefused, ServerFull
from services.live.aiortc_compat import on_key_frame_request, request_key_frame
from services.live.sessions.voice_offer import Direction, Endpoint, read_media_sections
from services.live.streaming.forwarding import (
    EncodedPicture,
    ForwardedScreen,
    ForwardedVoice,
    OpusPacket,
    on_opus_packet,
    on_vp8_picture,
)
from services.live.streaming.voice_slots import VoiceSlots

_CONNECT_TIMEOUT_S = 20.0
"""From the answer to a connection; a client that needs longer has left or can't get through."""
_POLL_S = 0.2
"""Between checks of who has stopped speaking."""
_KEY_FRAME_INTERVAL_S = 0.5
"""Between two requests for a key frame of a screen; they are large."""
Speakers = tuple[frozenset[str], tuple[str | None, ...]]
"""Participants who are speaking, and the participant in each slot."""
PacketListener = Callable[[str, OpusPacket], None]
"""Called with the participant and each packet of theirs that others hear."""


@dataclass(eq=False)
class VoiceConnection:
    """One connection of a participant."""

    meeting_id: str
    participant_id: str
    endpoint: Endpoint
    connection: RTCPeerConnection
    opened_s: float
    voice_tracks: list[ForwardedVoice] = field(default_factory=list)
    """By slot: what this participant hears."""
    screen_track: ForwardedScreen | None = None
    """The shared screen that this participant sees."""
    sends_voice: bool = False
    screen_receiver: RTCRtpReceiver | None = None
    """Receives the screen that this participant shares."""


@dataclass(eq=False)
class _VoiceRoom:
    """The voice connections of one meeting."""

    slots: VoiceSlots = field(default_factory=VoiceSlots)
    may_speak: set[str] = field(default_factory=set)
    """Participants whose microphone is on; what others send is not forwarded."""
    connections: dict[str, VoiceConnection] = field(default_factory=dict)
    sent: Speakers = (frozenset(), ())
    """What the control channel was last notified of."""
    key_frame_requested_s: float = 0.0
    polling: asyncio.Task[None] | None = None


class VoiceSessions:
    """All voice connections of this process. Every method runs on its event loop."""

    def __init__(
        self,
        on_speakers_changed: Callable[[str], None],
        *,
        ice_servers: list[str],
        max_connections: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`on_speakers_changed` is called with the id of a meeting; see `speakers_in`."""
        self._on_speakers_changed, self._clock = on_speakers_changed, clock
        self._max_connections = max_connections
        self._ice_servers = [RTCIceServer(urls=url) for url in ice_servers]
        self._connections: dict[str, VoiceConnection] = {}
        self._rooms: dict[str, _VoiceRoom] = {}
        self._presenters: dict[str, str] = {}
        """By meeting: the participant who may share a screen."""
        self._tasks: set[asyncio.Task[Any]] = set()
        self.packet_listeners: dict[str, PacketListener] = {}
        """By meeting: where what is said goes as well; see services.recording."""

    def __len__(self) -> int:
        return len(self._connections)

    async def open(
        self,
        meeting_id: str,
        participant_id: str,
        sdp_offer: str,
        endpoint: Endpoint = Endpoint.VOICE,
    ) -> tuple[str, str]:
        """Answer an SDP offer. Returns the session's id and the SDP answer.

        The connection that the participant had through the same endpoint is closed. Raises
        OfferRefused for an SDP that can't be answered, ServerFull where there are too many
        connections, and NotPresenting for a screen of a participant who may not present.
        """
        sections = read_media_sections(sdp_offer, endpoint)
        if ("video", "recvonly") in sections and not self.may_present(meeting_id, participant_id):
            raise NotPresenting(
                "a screen must come from whom the control channel lets present; got one of "
                "somebody else; ask to present first",
            )
        for old_id, old in list(self._connections.items()):
            if (old.participant_id, old.endpoint) == (participant_id, endpoint):
                await self.close(old_id)
        if len(self._connections) >= self._max_connections:
            raise ServerFull(
                f"at most {self._max_connections} voice connections fit on this server; got one "
                "more; try again"
            )
        configuration = RTCConfiguration(
            iceServers=self._ice_servers, bundlePolicy=RTCBundlePolicy.MAX_BUNDLE
        )
        connection = RTCPeerConnection(configuration)
        session = VoiceConnection(meeting_id, participant_id, endpoint, connection, self._clock())
        session_id = secrets.token_urlsafe(12)
        self._connections[session_id] = session
        self._room(meeting_id).connections[session_id] = session
        self._close_when_disconnected(session_id, connection)
        try:
            # before the remote description is set: aiortc matches transceivers in order
            for kind, direction in sections:
                self._add_transceiver(session, kind, direction)
            await connection.setRemoteDescription(RTCSessionDescription(sdp_offer, "offer"))
            await connection.setLocalDescription(await connection.createAnswer())
        except Exception as error:
            await self.close(session_id)
            reason = str(error) or type(error).__name__
            raise OfferRefused(
                f"the offer must be an SDP that can be answered; got one that fails with: {reason}"
            ) from error
        return session_id, connection.localDescription.sdp

    def find(self, session_id: str) -> VoiceConnection | None:
        """A running connection."""
        return self._connections.get(session_id)

    async def close(self, session_id: str) -> bool:
        """Close a connection; False where there is none of that id."""
        session = self._connections.pop(session_id, None)
        if session is None:
            return False
        room = self._rooms[session.meeting_id]
        del room.connections[session_id]
        if session.sends_voice and not _voice_source(room, session.participant_id):
            room.slots.release(session.participant_id)
        if not room.connections:
            del self._rooms[session.meeting_id]
            if room.polling is not None:
                room.polling.cancel()
        self._notify_if_changed(session.meeting_id, room)
        await session.connection.close()
        return True

    def is_active(self, meeting_id: str) -> bool:
        """Whether a meeting has any voice connection."""
        return meeting_id in self._rooms

    def speakers_in(self, meeting_id: str) -> Speakers:
        """Who is speaking in a meeting, and who is heard in which slot."""
        room = self._rooms.get(meeting_id)
        return room.sent if room else (frozenset(), ())

    def may_present(self, meeting_id: str, participant_id: str) -> bool:
        """Whether a participant may share their screen now."""
        return self._presenters.get(meeting_id) == participant_id

    async def set_permissions(
        self, meeting_id: str, *, listeners: set[str], speakers: set[str], presenter: str | None
    ) -> None:
        """Who may hear, whose microphone is on, who may share a screen.

        Connections of others are closed.
        """
        self._presenters.pop(meeting_id, None)
        if presenter is not None:
            self._presenters[meeting_id] = presenter
        room = self._rooms.get(meeting_id)
        if room is None:
            return
        for session_id, session in list(room.connections.items()):
            lost_screen = (
                session.screen_receiver is not None and session.participant_id != presenter
            )
            if session.participant_id not in listeners or lost_screen:
                await self.close(session_id)
        for muted in room.may_speak - speakers:
            room.slots.release(muted)
        room.may_speak = speakers
        self._notify_if_changed(meeting_id, room)

    async def close_all(self) -> None:
        """Close every connection, at shutdown."""
        await asyncio.gather(*(self.close(session_id) for session_id in list(self._connections)))

    def _room(self, meeting_id: str) -> _VoiceRoom:
        if meeting_id not in self._rooms:
            room = self._rooms[meeting_id] = _VoiceRoom()
            room.polling = asyncio.create_task(self._poll(meeting_id, room))
        return self._rooms[meeting_id]

    def _add_transceiver(self, session: VoiceConnection, kind: str, direction: Direction) -> None:
        """The server's side of one media section; `direction` is the server's."""
        sends = direction in ("sendonly", "sendrecv")
        receives = direction in ("recvonly", "sendrecv")
        track: ForwardedVoice | ForwardedScreen | str = kind

        def on_key_frame_needed() -> None:
            self._request_key_frame(session.meeting_id)

        if sends and kind == "audio":
            track = ForwardedVoice(self._clock)
            session.voice_tracks.append(track)
        elif sends:
            track = session.screen_track = ForwardedScreen(self._clock, on_key_frame_needed)
        transceiver = session.connection.addTransceiver(track, direction=direction)
        _prefer_codec(transceiver, "audio/opus" if kind == "audio" else "video/VP8")
        if sends and kind == "video":
            on_key_frame_request(transceiver.sender, on_key_frame_needed)
        if receives and kind == "audio":
            session.sends_voice = True
            on_opus_packet(
                transceiver.receiver, lambda packet: self._forward_voice(session, packet)
            )
        elif receives:
            session.screen_receiver = transceiver.receiver
            on_vp8_picture(
                transceiver.receiver, lambda picture: self._forward_screen(session, picture)
            )

    def _forward_voice(self, session: VoiceConnection, packet: OpusPacket) -> None:
        room = self._rooms.get(session.meeting_id)
        if room is None or session.participant_id not in room.may_speak:
            return
        if _voice_source(room, session.participant_id) is not session:
            return
        slot = room.slots.assign(session.participant_id, self._clock(), voice=packet.voice)
        if slot is None:
            return
        self._notify_if_changed(session.meeting_id, room)
        for other in room.connections.values():
            if other.participant_id != session.participant_id and slot < len(other.voice_tracks):
                other.voice_tracks[slot].send(session, packet)
        if listener := self.packet_listeners.get(session.meeting_id):
            listener(session.participant_id, packet)

    def _forward_screen(self, session: VoiceConnection, picture: EncodedPicture) -> None:
        room = self._rooms.get(session.meeting_id)
        for other in room.connections.values() if room else ():
            if other.participant_id != session.participant_id and other.screen_track is not None:
                other.screen_track.send(session, picture)

    def _request_key_frame(self, meeting_id: str) -> None:
        room, now_s = self._rooms.get(meeting_id), self._clock()
        if room is None or now_s - room.key_frame_requested_s < _KEY_FRAME_INTERVAL_S:
            return
        room.key_frame_requested_s = now_s
        for session in room.connections.values():
            if session.screen_receiver is not None:
                self._run(request_key_frame(session.screen_receiver))

    def _notify_if_changed(self, meeting_id: str, room: _VoiceRoom) -> None:
        speakers = (room.slots.speaking(self._clock()), room.slots.holders())
        if speakers != room.sent:
            room.sent = speakers
            self._on_speakers_changed(meeting_id)

    async def _poll(self, meeting_id: str, room: _VoiceRoom) -> None:
        """Notice who has stopped speaking; close what never connected."""
        while True:
            await asyncio.sleep(_POLL_S)
            self._notify_if_changed(meeting_id, room)
            for session_id, session in room.connections.items():
                late = self._clock() - session.opened_s > _CONNECT_TIMEOUT_S
                if late and session.connection.connectionState != "connected":
                    self._run(self.close(session_id))

    def _run(self, work: Coroutine[Any, Any, object]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _close_when_disconnected(self, session_id: str, connection: RTCPeerConnection) -> None:
        @connection.on("connectionstatechange")
        async def on_state() -> None:
            if connection.connectionState in ("failed", "closed"):
                await self.close(session_id)


def _voice_source(room: _VoiceRoom, participant_id: str) -> VoiceConnection | None:
    """Which connection a participant's voice is taken from: WHIP if they have it, else the page."""
    candidates = [
        session
        for session in room.connections.values()
        if session.participant_id == participant_id and session.sends_voice
    ]
    return max(candidates, key=lambda session: session.endpoint is Endpoint.WHIP, default=None)


def _prefer_codec(transceiver: RTCRtpTransceiver, mime: str) -> None:
    kind = mime.partition("/")[0]
    codecs = RTCRtpSender.getCapabilities(kind).codecs
    wanted = {mime.lower(), "video/rtx"} if kind == "video" else {mime.lower()}
    transceiver.setCodecPreferences([c for c in codecs if c.mimeType.lower() in wanted])
