"""Somebody in a meeting without a page: their performer moves as a webcam shows them.

They open one WHEP connection, as a page does, and drive their performer over its channel
`keypoints`; with live look their cut-out pictures go up beside it (docs/live-look.md). They look at
nothing, so that the server draws nothing for them. Where the meeting moves, `presence` follows.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import httpx
from aiortc import (
    RTCConfiguration,
    RTCIceServer,
    RTCPeerConnection,
    RTCSessionDescription,
)

from services.joining.look_track import LookTrack
from services.joining.seat import MeetingAway, NotJoined, Seat, refusal
from services.live.aiortc_compat import on_encoded_frame, on_key_frame_request
from services.live.keypoints_packet import (
    LONGEST_KEYPOINTS_BYTES,
    KeypointsPacket,
    encode_keypoints,
)
from services.live.packets import ViewPacket, encode_view

_NEWEST = {"ordered": False, "maxRetransmits": 0}
_VIEW_S = 1.0
"""Between viewpoints, by which the server knows that somebody is still there."""
_AT_WORST_S = 20.0
_MOST_BUFFERED = 2 * LONGEST_KEYPOINTS_BYTES
_NO_VIEW = ViewPacket(0, 0.0, (0.0, 1.0, 3.0), (0.0, 1.0, 0.0, 0.0), 0.7, 128, 128, sound_only=True)


class MeetingMember:
    """A connection that drives one performer, at the gateway that the meeting lives on. Every
    method runs on its event loop."""

    def __init__(
        self,
        seat: Seat,
        gateway_url: str,
        *,
        live_look: bool,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._whep_url = seat.whep_url(gateway_url)
        servers = [RTCIceServer(**one) for one in seat.ice_servers]
        self._seat, self._peer = seat, RTCPeerConnection(RTCConfiguration(iceServers=servers))
        self._view = self._peer.createDataChannel("view", **_NEWEST)
        self._keypoints = self._peer.createDataChannel(
            "keypoints", protocol=seat.performer_id, **_NEWEST
        )
        self._keypoints.on("message", self._on_refusal)
        receiving = self._peer.addTransceiver("video", direction="recvonly")
        on_encoded_frame(receiving.receiver, lambda *_: None)
        self.look = LookTrack(clock) if live_look else None
        """Takes pictures; None without live look."""
        if self.look is not None:
            sending = self._peer.addTransceiver(self.look, direction="sendonly")
            on_key_frame_request(sending.sender, self.look.request_key_frame)
        self._sequence = 0
        self._refused: str | None = None
        self._watching: asyncio.Task[None] | None = None
        self._location: str | None = None
        """The session's, to end it."""

    @property
    def is_cut_off(self) -> bool:
        """Whether a connection that came about is over."""
        gone = self._peer.connectionState in ("failed", "closed")
        return gone or self._keypoints.readyState == "closed"

    async def connect(self) -> None:
        """Be in the meeting. Raises NotJoined, MeetingAway."""
        await self._peer.setLocalDescription(await self._peer.createOffer())
        try:
            async with httpx.AsyncClient(timeout=_AT_WORST_S) as caller:
                answer = await caller.post(
                    self._whep_url,
                    content=self._peer.localDescription.sdp,
                    headers=self._headers() | {"Content-Type": "application/sdp"},
                )
        except httpx.TransportError as error:
            raise MeetingAway(f"the meeting's server must answer; got {error!r}") from error
        if answer.status_code != httpx.codes.CREATED:
            raise refusal(answer)
        self._location = answer.headers.get("Location")
        await self._peer.setRemoteDescription(RTCSessionDescription(answer.text, "answer"))
        deadline_s = time.monotonic() + _AT_WORST_S
        while self._keypoints.readyState != "open" or self._view.readyState != "open":
            if time.monotonic() > deadline_s or self._peer.connectionState == "failed":
                raise MeetingAway(
                    "a connection must come about within "
                    f"{_AT_WORST_S:g} s; got none; a firewall may keep UDP from the server"
                )
            await asyncio.sleep(0.02)
        self._watching = asyncio.create_task(self._stay())

    def send(self, packet: KeypointsPacket) -> bool:
        """Send what the webcam saw, if it can go out at once; says whether it did.

        The packet's sequence and whether live look is on are filled in. Raises NotJoined once the
        meeting has refused.
        """
        if self._refused is not None:
            raise NotJoined(self._refused)
        channel = self._keypoints
        if channel.readyState != "open" or channel.bufferedAmount > _MOST_BUFFERED:
            return False
        self._sequence += 1
        on = self.look is not None
        channel.send(encode_keypoints(replace(packet, sequence=self._sequence, live_look=on)))
        return True

    async def leave(self) -> None:
        """Give the seat back; the performer goes back to their recorded motion."""
        if self._location is not None:
            # the server notices by itself, too
            with suppress(httpx.HTTPError):
                async with httpx.AsyncClient(timeout=_AT_WORST_S) as caller:
                    address = httpx.URL(self._whep_url).join(self._location)
                    await caller.delete(address, headers=self._headers())
        await self.close()

    async def close(self) -> None:
        """End the connection alone."""
        if self._watching is not None:
            self._watching.cancel()
        await self._peer.close()

    def _headers(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self._seat.token}"}

    def _on_refusal(self, message: object) -> None:
        """The server speaks on this channel only to refuse."""
        problem = json.loads(message) if isinstance(message, str) else {}
        self._refused = problem.get("detail", "the meeting refused the motion")

    async def _stay(self) -> None:
        sequence = 0
        while self._view.readyState == "open":
            sequence += 1
            self._view.send(encode_view(replace(_NO_VIEW, sequence=sequence)))
            await asyncio.sleep(_VIEW_S)
