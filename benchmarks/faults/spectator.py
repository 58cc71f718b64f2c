"""Somebody in a meeting for whom the server draws, and who notes for how long nothing moves."""

from __future__ import annotations

import asyncio
import time
from contextlib import AbstractContextManager, suppress
from urllib.parse import urljoin

import httpx
import numpy as np
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError
from av import VideoFrame

from benchmarks.faults.line import running
from services.live.packets import ViewPacket, encode_view

_AGAIN_S = 0.5
_LOST_S = 4.0
"""Without a picture for so long our page asks for a new view."""
_VIEW_S = 0.4
_PX = 256


class Spectator:
    """Looks on from the front, and comes back where their view is lost."""

    def __init__(self, address: str, token: str, meeting_id: str) -> None:
        """At the gateway at `address`, with a token that may join."""
        self._address, self._meeting_id = address, meeting_id
        self._header = {"Authorization": f"Bearer {token}"}
        self._loop = asyncio.new_event_loop()
        self._task: asyncio.Task[None] | None = None
        self._moved_s, self._gap_s = time.monotonic(), 0.0
        self.sees = False
        """Whether anything was seen to move since the last look."""

    def run(self) -> None:
        """Look on until `end`."""
        self._task = self._loop.create_task(self._watch())
        with suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._task)
        self._loop.close()

    def end(self) -> None:
        """Go."""
        if self._task is not None:
            self._loop.call_soon_threadsafe(self._task.cancel)

    def collect(self) -> float:
        """The longest time in which nobody moved since the last look, s."""
        gap_s = max(self._gap_s, time.monotonic() - self._moved_s)
        self._gap_s, self.sees = 0.0, False
        return gap_s

    async def _watch(self) -> None:
        while True:
            peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
            try:
                await self._look(peer)
            except (httpx.HTTPError, OSError, TimeoutError, MediaStreamError):
                await asyncio.sleep(_AGAIN_S)
            finally:
                await peer.close()

    async def _look(self, peer: RTCPeerConnection) -> None:
        """One view, until it is lost."""
        channel = peer.createDataChannel("view", ordered=False, maxRetransmits=0)
        receiver = peer.addTransceiver("video", direction="recvonly").receiver
        await peer.setLocalDescription(await peer.createOffer())
        async with httpx.AsyncClient() as caller:
            path = f"{self._address}/v1/meetings/{self._meeting_id}/join"
            joined = await caller.post(
                path, json={"display_name": "Spectator"}, headers=self._header
            )
            seat = joined.raise_for_status().json()
            answer = await caller.post(
                urljoin(self._address, seat["whep_url"]),
                content=peer.localDescription.sdp,
                headers={
                    "Authorization": f"Bearer {seat['token']}",
                    "Content-Type": "application/sdp",
                },
            )
        answer.raise_for_status()
        await peer.setRemoteDescription(RTCSessionDescription(answer.text, "answer"))
        sequence, told_s, before = 0, 0.0, None
        while True:
            frame = await asyncio.wait_for(receiver.track.recv(), _LOST_S)
            assert isinstance(frame, VideoFrame)
            now_s, picture = time.monotonic(), frame.to_ndarray(format="gray")
            if before is None or before.shape != picture.shape or np.any(before != picture):
                self._gap_s = max(self._gap_s, now_s - self._moved_s)
                self._moved_s, self.sees = now_s, True
            before = picture
            if channel.readyState == "open" and now_s - told_s > _VIEW_S:
                sequence, told_s = sequence + 1, now_s
                channel.send(_from_the_front(sequence))


def _from_the_front(sequence: int) -> bytes:
    turned = (0.0, 1.0, 0.0, 0.0)
    return encode_view(ViewPacket(sequence, 0.0, (0.0, 1.0, 3.0), turned, 0.7, _PX, _PX))


def looking_on(address: str, token: str, meeting_id: str) -> AbstractContextManager[Spectator]:
    """A spectator on a thread of their own."""
    return running(Spectator(address, token, meeting_id))
