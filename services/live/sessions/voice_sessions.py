"""The connections by which people talk, and what goes from one to the others."""

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

from services.live.sessions.view_sessions import NoRoom, OfferRefused
from services.live.sessions.voice_offer import Direction, Door, read_sections
from services.live.streaming.forwarding import (
    ForwardedVideo,
    ForwardedVoice,
    OpusPacket,
    VideoFrame,
    ask_for_key_frame,
    tap_opus,
    tap_video,
)
from services.live.streaming.voice_slots import Slots
from services.problems import ProblemError

_CONNECT_S = 20.0
"""Time from the answer to a connection; who needs longer has gone away or can't get through."""
_SETTLE_S = 0.2
"""Between two looks at who has stopped speaking."""
_KEY_FRAME_S = 0.5
"""Between two requests for whole pictures of a screen; they are large."""
Speakers = tuple[frozenset[str], tuple[str | None, ...]]
"""Who speaks, and who holds which slot."""
Listener = Callable[[str, OpusPacket], None]
"""Told the participant and each packet of theirs that others hear."""


@dataclass(eq=False)
class Call:
    """One connection of somebody in a meeting."""

    meeting_id: str
    participant_id: str
    door: Door
    connection: RTCPeerConnection
    opened_s: float
    ears: list[ForwardedVoice] = field(default_factory=list)
    eye: ForwardedVideo | None = None
    speaks: bool = False
    screen: RTCRtpReceiver | None = None


@dataclass(eq=False)
class _Talk:
    """What goes on in one meeting."""

    slots: Slots = field(default_factory=Slots)
    may_speak: set[str] = field(default_factory=set)
    """Participants whose microphone is on; what others send is not heard."""
    calls: dict[str, Call] = field(default_factory=dict)
    told: Speakers = (frozenset(), ())
    asked_key_s: float = 0.0
    settling: asyncio.Task[None] | None = None


class VoiceSessions:
    """All voice connections of this process. Every method runs on its event loop."""

    def __init__(
        self,
        on_speaking: Callable[[str], None],
        *,
        ice_servers: list[str],
        max_calls: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._on_speaking, self._clock, self._max_calls = on_speaking, clock, max_calls
        self._ice = [RTCIceServer(urls=url) for url in ice_servers]
        self._calls: dict[str, Call] = {}
        self._talks: dict[str, _Talk] = {}
        self._presenters: dict[str, str] = {}
        """By meeting: who may share a screen."""
        self._tasks: set[asyncio.Task[Any]] = set()
        self.listeners: dict[str, Listener] = {}
        """By meeting: who keeps what is said; see services.recording."""

    def __len__(self) -> int:
        return len(self._calls)

    async def open(
        self, meeting_id: str, participant_id: str, sdp_offer: str, door: Door = Door.VOICE
    ) -> tuple[str, str]:
        """Answer an offer. Returns the session's id and the SDP answer.

        The connection that the participant had by the same door ends. Raises OfferRefused for an
        SDP that can't be answered, NoRoom where the server is full, and a 403 problem for a screen
        of somebody who may not present.
        """
        sections = read_sections(sdp_offer, door)
        if ("video", "recvonly") in sections and not self.may_present(meeting_id, participant_id):
            raise ProblemError(
                403,
                "not-presenting",
                "a screen must come from whom the control channel lets present; got one of "
                "somebody else; ask to present first",
            )
        for old_id, old in list(self._calls.items()):
            if (old.participant_id, old.door) == (participant_id, door):
                await self.close(old_id)
        if len(self._calls) >= self._max_calls:
            raise NoRoom(
                f"at most {self._max_calls} voice connections fit on this server; got one more; "
                "try again"
            )
        configuration = RTCConfiguration(
            iceServers=self._ice, bundlePolicy=RTCBundlePolicy.MAX_BUNDLE
        )
        connection = RTCPeerConnection(configuration)
        call = Call(meeting_id, participant_id, door, connection, self._clock())
        call_id = secrets.token_urlsafe(12)
        self._calls[call_id] = self._talk(meeting_id).calls[call_id] = call
        self._listen(call_id, connection)
        try:
            # before the remote description is set: it takes them in order
            for kind, direction in sections:
                self._add(call, kind, direction)
            await connection.setRemoteDescription(RTCSessionDescription(sdp_offer, "offer"))
            await connection.setLocalDescription(await connection.createAnswer())
        except Exception as error:
            await self.close(call_id)
            reason = str(error) or type(error).__name__
            raise OfferRefused(
                f"the offer must be an SDP that can be answered; got one that fails with: {reason}"
            ) from error
        return call_id, connection.localDescription.sdp

    def find(self, session_id: str) -> Call | None:
        """A running connection."""
        return self._calls.get(session_id)

    async def close(self, session_id: str) -> bool:
        """Hang up; False when there is none of that id."""
        call = self._calls.pop(session_id, None)
        if call is None:
            return False
        talk = self._talks[call.meeting_id]
        del talk.calls[session_id]
        if call.speaks and not _source(talk, call.participant_id):
            talk.slots.drop(call.participant_id)
        if not talk.calls:
            del self._talks[call.meeting_id]
            if talk.settling is not None:
                talk.settling.cancel()
        self._tell(call.meeting_id, talk)
        await call.connection.close()
        return True

    def talked_in(self, meeting_id: str) -> bool:
        """Whether anybody is connected in a meeting."""
        return meeting_id in self._talks

    def speaking_in(self, meeting_id: str) -> Speakers:
        """Who speaks in a meeting, and who is heard in which slot."""
        talk = self._talks.get(meeting_id)
        return talk.told if talk else (frozenset(), ())

    def may_present(self, meeting_id: str, participant_id: str) -> bool:
        """Whether somebody may share their screen now."""
        return self._presenters.get(meeting_id) == participant_id

    async def allow(
        self, meeting_id: str, hear: set[str], speak: set[str], presenter: str | None
    ) -> None:
        """Who may hear, whose microphone is on, who may share a screen; others are cut off."""
        self._presenters.pop(meeting_id, None)
        if presenter is not None:
            self._presenters[meeting_id] = presenter
        talk = self._talks.get(meeting_id)
        if talk is None:
            return
        for call_id, call in list(talk.calls.items()):
            stops_sharing = call.screen is not None and call.participant_id != presenter
            if call.participant_id not in hear or stops_sharing:
                await self.close(call_id)
        for silenced in talk.may_speak - speak:
            talk.slots.drop(silenced)
        talk.may_speak = speak
        self._tell(meeting_id, talk)

    async def close_all(self) -> None:
        """Hang up for all, at shutdown."""
        await asyncio.gather(*(self.close(call_id) for call_id in list(self._calls)))

    def _talk(self, meeting_id: str) -> _Talk:
        if meeting_id not in self._talks:
            talk = self._talks[meeting_id] = _Talk()
            talk.settling = asyncio.create_task(self._settle(meeting_id, talk))
        return self._talks[meeting_id]

    def _add(self, call: Call, kind: str, direction: Direction) -> None:
        """One section of the offer, as the server takes part in it; `direction` is the server's."""
        sends, receives = (
            direction in ("sendonly", "sendrecv"),
            direction in ("recvonly", "sendrecv"),
        )
        track: ForwardedVoice | ForwardedVideo | str = kind
        if sends and kind == "audio":
            track = ForwardedVoice(self._clock)
            call.ears.append(track)
        elif sends:
            track = call.eye = ForwardedVideo(
                self._clock, lambda: self._ask_for_key(call.meeting_id)
            )
        transceiver = call.connection.addTransceiver(track, direction=direction)
        _prefer(transceiver, "audio/opus" if kind == "audio" else "video/VP8")
        if sends and kind == "video":
            # a viewer who lost a picture asks aiortc's encoder, which has none to give
            sender = transceiver.sender
            sender._send_keyframe = lambda: self._ask_for_key(call.meeting_id)  # type: ignore[method-assign]
        if receives and kind == "audio":
            call.speaks = True
            tap_opus(transceiver.receiver, lambda packet: self._heard(call, packet))
        elif receives:
            call.screen = transceiver.receiver
            tap_video(transceiver.receiver, lambda frame: self._seen(call, frame))

    def _heard(self, call: Call, packet: OpusPacket) -> None:
        talk = self._talks.get(call.meeting_id)
        if talk is None or call.participant_id not in talk.may_speak:
            return
        if _source(talk, call.participant_id) is not call:
            return
        slot = talk.slots.take(call.participant_id, self._clock(), voice=packet.voice)
        if slot is None:
            return
        self._tell(call.meeting_id, talk)
        for other in talk.calls.values():
            if other.participant_id != call.participant_id and slot < len(other.ears):
                other.ears[slot].offer(call, packet)
        if listener := self.listeners.get(call.meeting_id):
            listener(call.participant_id, packet)

    def _seen(self, call: Call, frame: VideoFrame) -> None:
        talk = self._talks.get(call.meeting_id)
        for other in talk.calls.values() if talk else ():
            if other.participant_id != call.participant_id and other.eye is not None:
                other.eye.offer(call, frame)

    def _ask_for_key(self, meeting_id: str) -> None:
        talk, now_s = self._talks.get(meeting_id), self._clock()
        if talk is None or now_s - talk.asked_key_s < _KEY_FRAME_S:
            return
        talk.asked_key_s = now_s
        for call in talk.calls.values():
            if call.screen is not None:
                self._do(ask_for_key_frame(call.screen))

    def _tell(self, meeting_id: str, talk: _Talk) -> None:
        news = (talk.slots.speaking(self._clock()), talk.slots.holders())
        if news != talk.told:
            talk.told = news
            self._on_speaking(meeting_id)

    async def _settle(self, meeting_id: str, talk: _Talk) -> None:
        """Tell who has stopped speaking; end what never connected."""
        while True:
            await asyncio.sleep(_SETTLE_S)
            self._tell(meeting_id, talk)
            for call_id, call in talk.calls.items():
                late = self._clock() - call.opened_s > _CONNECT_S
                if late and call.connection.connectionState != "connected":
                    self._do(self.close(call_id))

    def _do(self, work: Coroutine[Any, Any, object]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _listen(self, call_id: str, connection: RTCPeerConnection) -> None:
        @connection.on("connectionstatechange")
        async def on_state() -> None:
            if connection.connectionState in ("failed", "closed"):
                await self.close(call_id)


def _source(talk: _Talk, participant_id: str) -> Call | None:
    """Where somebody's voice comes from: by WHIP, where they have that, else by their page."""
    theirs = [c for c in talk.calls.values() if c.participant_id == participant_id and c.speaks]
    return max(theirs, key=lambda call: call.door is Door.WHIP, default=None)


def _prefer(transceiver: RTCRtpTransceiver, mime: str) -> None:
    kind = mime.partition("/")[0]
    codecs = RTCRtpSender.getCapabilities(kind).codecs
    wanted = {mime.lower(), "video/rtx"} if kind == "video" else {mime.lower()}
    transceiver.setCodecPreferences([c for c in codecs if c.mimeType.lower() in wanted])
