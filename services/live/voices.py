"""Voices in a meeting: `POST /v1/meetings/{id}/voice` answers an SDP offer of one audio, both ways.

A connection of its own: a picture that stalls is replaced without cutting anybody off. It answers
as WHEP does, 201 with `Location`; `DELETE` there hangs up. Whoever's microphone is on, by the
control channel, is heard by all others who are connected to this gateway.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from aiortc import (
    MediaStreamTrack,
    RTCConfiguration,
    RTCIceServer,
    RTCPeerConnection,
    RTCSessionDescription,
)
from aiortc.mediastreams import MediaStreamError
from av import AudioFrame
from fastapi import APIRouter, Depends, Request, Response, status
from fastapi.concurrency import run_in_threadpool

from db.models import MeetingRow
from services import seats
from services.auth import Joiner
from services.container import Provided, Services
from services.live.mixer import Mixer, Voice
from services.live.sessions import OfferRefused
from services.live.whep import SDP, read_offer
from services.problems import PROBLEMS, ProblemError

log = logging.getLogger(__name__)

router = APIRouter(prefix="/v1/meetings", tags=["meetings"], responses=PROBLEMS)


@dataclass(eq=False)
class _Call:
    meeting_id: str
    connection: RTCPeerConnection
    voice: Voice
    listening: asyncio.Task[None] | None = None


class VoiceSessions:
    """All voice connections of this process. Every method runs on its event loop."""

    def __init__(
        self, on_speaking: Callable[[str, frozenset[str]], None], *, ice_servers: list[str]
    ) -> None:
        self._on_speaking = on_speaking
        self._ice = [RTCIceServer(urls=url) for url in ice_servers]
        self._calls: dict[str, _Call] = {}
        self._mixers: dict[str, tuple[Mixer, asyncio.Task[None]]] = {}

    def __len__(self) -> int:
        return len(self._calls)

    async def open(self, meeting_id: str, participant_id: str, sdp_offer: str) -> tuple[str, str]:
        """Answer an offer. Returns the session's id and the SDP answer.

        The connection that the participant had before ends. Raises OfferRefused for an SDP that
        can't be answered.
        """
        for old_id, old in list(self._calls.items()):
            if old.voice.participant_id == participant_id:
                await self.close(old_id)
        connection = RTCPeerConnection(RTCConfiguration(iceServers=self._ice))
        call = _Call(meeting_id, connection, Voice(participant_id))
        call_id = secrets.token_urlsafe(12)
        self._calls[call_id] = call
        self._listen(call_id, call)
        try:
            # before the remote description is set: it takes the offered audio
            connection.addTransceiver(call.voice, direction="sendrecv")
            await connection.setRemoteDescription(RTCSessionDescription(sdp_offer, "offer"))
            await connection.setLocalDescription(await connection.createAnswer())
        except Exception as error:
            await self.close(call_id)
            reason = str(error) or type(error).__name__
            raise OfferRefused(
                f"the offer must be an SDP of one audio; got an offer that fails with: {reason}"
            ) from error
        self._mixer(meeting_id).voices.add(call.voice)
        return call_id, connection.localDescription.sdp

    async def close(self, call_id: str) -> bool:
        """Hang up; False when there is none of that id."""
        call = self._calls.pop(call_id, None)
        if call is None:
            return False
        if call.listening is not None:
            call.listening.cancel()
        mixer, task = self._mixers.get(call.meeting_id, (None, None))
        if mixer is not None and task is not None:
            mixer.voices.discard(call.voice)
            if not mixer.voices:
                task.cancel()
                del self._mixers[call.meeting_id]
        call.voice.stop()
        await call.connection.close()
        return True

    def talked_in(self, meeting_id: str) -> bool:
        """Whether anybody is connected in a meeting."""
        return meeting_id in self._mixers

    async def allow(self, meeting_id: str, hear: set[str], speak: set[str]) -> None:
        """Who may hear, and whose microphone is on; the others are cut off."""
        for call_id, call in list(self._calls.items()):
            if call.meeting_id == meeting_id and call.voice.participant_id not in hear:
                await self.close(call_id)
        if meeting_id in self._mixers:
            self._mixers[meeting_id][0].may_speak = speak

    async def close_all(self) -> None:
        """Hang up for all, at shutdown."""
        await asyncio.gather(*(self.close(call_id) for call_id in list(self._calls)))

    def _mixer(self, meeting_id: str) -> Mixer:
        if meeting_id not in self._mixers:
            mixer = Mixer(lambda speaking: self._on_speaking(meeting_id, speaking))
            self._mixers[meeting_id] = (mixer, asyncio.create_task(mixer.run()))
        return self._mixers[meeting_id][0]

    def _listen(self, call_id: str, call: _Call) -> None:
        connection = call.connection

        @connection.on("track")
        def on_track(track: MediaStreamTrack) -> None:
            if track.kind == "audio" and call.listening is None:
                call.listening = asyncio.create_task(_take(track, call.voice))

        @connection.on("connectionstatechange")
        async def on_state() -> None:
            if connection.connectionState in ("failed", "closed"):
                await self.close(call_id)


async def _take(track: MediaStreamTrack, voice: Voice) -> None:
    while True:
        try:
            frame = await track.recv()
        except MediaStreamError:
            return
        assert isinstance(frame, AudioFrame)
        # aiortc decodes Opus to interleaved stereo
        stereo = frame.to_ndarray().reshape(-1, 2).astype(np.int32)
        voice.say((stereo.sum(axis=1) // 2).astype(np.int16))


def _sessions(request: Request) -> VoiceSessions:
    return request.app.state.voices


Voices = Annotated[VoiceSessions, Depends(_sessions)]


@router.post(
    "/{meeting_id}/voice",
    status_code=status.HTTP_201_CREATED,
    summary="Talk in a meeting",
    response_class=Response,
    responses={201: {"content": {SDP: {}}, "description": "The SDP answer."}},
)
async def talk(
    meeting_id: str, request: Request, services: Provided, voices: Voices, caller: Joiner
) -> Response:
    """One's microphone up, all others down; from a seat whose owner is let in."""
    caller.require_meeting(meeting_id)
    if caller.participant_id is None:
        raise ProblemError(
            403, "no-seat", "the token must be one that joining gave; got one without a seat; join"
        )
    sdp_offer = await read_offer(request)
    meeting = await run_in_threadpool(_meeting, services, meeting_id)
    seats.require_admitted(meeting, caller)
    call_id, sdp_answer = await voices.open(meeting_id, caller.participant_id, sdp_offer)
    request.app.state.hub.stir(meeting_id)
    headers = {"Location": f"/v1/meetings/{meeting_id}/voice/{call_id}"}
    return Response(sdp_answer, status.HTTP_201_CREATED, headers, media_type=SDP)


@router.delete("/{meeting_id}/voice/{call_id}", summary="Hang up")
async def hang_up(meeting_id: str, call_id: str, voices: Voices, caller: Joiner) -> Response:
    """End the connection."""
    caller.require_meeting(meeting_id)
    if not await voices.close(call_id):
        raise ProblemError(
            404, "not-found", f"id must be that of a running call; got {call_id!r}; it may be over"
        )
    return Response(status_code=status.HTTP_200_OK)


def _meeting(services: Services, meeting_id: str) -> MeetingRow:
    with services.reading() as unit:
        return unit.meetings.get(meeting_id)
