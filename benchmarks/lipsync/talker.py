"""Somebody who opens their mouth and is heard at the same moment, again and again, without webcam.

Landmarks and jaw go to a meeting as a page sends them, 30 times a second; the voice goes as Opus,
20 ms a packet, each sent once its last sample has been taken in, as microphones give it.
"""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from typing import Any

import httpx
import numpy as np
from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection
from aiortc.stats import RTCTransportStats
from av import AudioFrame
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as open_socket

from benchmarks.live_people import (
    NEWEST,
    RATE_HZ,
    SIZE_PX,
    connect,
    landmarks_of_one_who_turns,
)
from capture.body.expressions import ALL_GROUPS, ObservedExpression
from scene.arrays import Array, Int
from scene.expression import EXPRESSION_NAMES, neutral
from services.live.keypoints_packet import KeypointsPacket, encode_keypoints
from services.live.packets import ViewPacket, encode_view

AUDIO_HZ = 48_000
PERIOD_S = 1.037
"""From one opening to the next: every phase against pictures and packets comes by."""
OPEN_S = 0.45
CLICK_S, CLICK_HZ = 0.08, 1000.0
_LOUD, _QUIET = 0.6, 0.01
"""Of the click, and of the hum between clicks, so that it is never silence that is sent."""
_PACKET_SAMPLES = 960
_DATAGRAM_HEADER_BYTES = 28
"""Of IPv4 and UDP."""
_AT_WORST_S = 60.0
_JAW = EXPRESSION_NAMES.index("jaw_open")


def is_open(time_s: float) -> bool:
    """Whether the mouth is open so long after the first opening."""
    return time_s >= 0.0 and time_s % PERIOD_S < OPEN_S


def sound(first: int, count: int) -> Int[Array, "N"]:
    """So many samples from the sample `first` after the first opening: a click at each opening."""
    time_s = np.arange(first, first + count) / AUDIO_HZ
    clicks = (time_s >= 0.0) & (time_s % PERIOD_S < CLICK_S)
    wave = np.sin(2.0 * np.pi * CLICK_HZ * (time_s % PERIOD_S))
    return np.rint(32767.0 * np.where(clicks, _LOUD, _QUIET) * wave).astype(np.int16)


class _Microphone(MediaStreamTrack):
    """The sound, each packet when its last sample has been taken in."""

    kind = "audio"

    def __init__(self, first_opening_s: float) -> None:
        super().__init__()
        self._first_opening_s, self._at = first_opening_s, 0
        self._offset: int | None = None

    async def recv(self) -> AudioFrame:
        if self._offset is None:
            self._offset = round(AUDIO_HZ * (time.time() - self._first_opening_s))
        first = self._offset + self._at
        due_s = self._first_opening_s + (first + _PACKET_SAMPLES) / AUDIO_HZ
        await asyncio.sleep(max(0.0, due_s - time.time()))
        samples = sound(first, _PACKET_SAMPLES)
        frame = AudioFrame.from_ndarray(samples[None], format="s16", layout="mono")
        frame.sample_rate, frame.pts = AUDIO_HZ, self._at
        frame.time_base = Fraction(1, AUDIO_HZ)
        self._at += _PACKET_SAMPLES
        return frame


class TalkingPerson:
    """A host with a seat, who moves one performer and talks."""

    def __init__(
        self,
        address: str,
        meeting_id: str,
        token: str,
        performer: str,
        *,
        found_after_s: float = 0.0,
    ) -> None:
        """`found_after_s`: so long after its moment a packet of landmarks leaves, as it does where
        they have to be found in a picture first."""
        self.first_opening_s = 0.0
        """By this machine's clock, s since 1970; known while talking."""
        self._address, self._meeting_id, self._token = address, meeting_id, token
        self._performer, self._found_after_s = performer, found_after_s
        self._standing = landmarks_of_one_who_turns()[0]
        self._talking, self._end = threading.Event(), threading.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._control: ClientConnection | None = None
        self._picture: RTCPeerConnection | None = None

    @contextmanager
    def talking(self) -> Iterator[None]:
        """Talk, on a thread of its own."""
        thread = threading.Thread(target=lambda: asyncio.run(self._talk()), daemon=True)
        thread.start()
        try:
            if not self._talking.wait(_AT_WORST_S):
                raise RuntimeError("somebody must talk within a minute; got nobody who did")
            yield
        finally:
            self._end.set()
            thread.join(10.0)

    def say(self, **message: Any) -> None:
        """Send a message on the control channel."""
        assert self._loop is not None
        assert self._control is not None
        sending = self._control.send(json.dumps(message))
        asyncio.run_coroutine_threadsafe(sending, self._loop).result(10.0)

    def sent_bits(self) -> float:
        """Bits of landmarks on the wire so far, headers of every layer down to IP included."""
        assert self._loop is not None
        return asyncio.run_coroutine_threadsafe(self._sent_bits(), self._loop).result(10.0)

    async def _sent_bits(self) -> float:
        assert self._picture is not None
        told = (await self._picture.getStats()).values()
        sent = {one.id: one for one in told if isinstance(one, RTCTransportStats)}
        return 8.0 * sum(
            one.bytesSent + _DATAGRAM_HEADER_BYTES * one.packetsSent for one in sent.values()
        )

    async def _talk(self) -> None:
        self._loop = asyncio.get_running_loop()
        seat = await self._seat()
        address = f"ws{self._address.removeprefix('http').rstrip('/')}{seat['control_url']}"
        picture, voice = (RTCPeerConnection(RTCConfiguration(iceServers=[])) for _ in range(2))
        self._picture = picture
        async with open_socket(address) as control:
            self._control = control
            await control.send(
                json.dumps({"type": "hello", "token": seat["token"], "name": "Talker"})
            )
            beating = asyncio.create_task(self._beat(control))
            await control.send(json.dumps({"type": "microphone", "on": True}))
            self.first_opening_s = time.time() + 1.0
            voice.addTransceiver(_Microphone(self.first_opening_s), direction="sendonly")
            place = f"{self._address}v1/meetings/{self._meeting_id}/voice"
            await connect(voice, place, seat["token"])
            await self._move(picture)
            beating.cancel()
            await asyncio.gather(picture.close(), voice.close())

    async def _seat(self) -> dict[str, Any]:
        header = {"Authorization": f"Bearer {self._token}"}
        async with httpx.AsyncClient(base_url=self._address, timeout=_AT_WORST_S) as caller:
            path = f"/v1/meetings/{self._meeting_id}/join"
            answer = await caller.post(path, json={"display_name": "Talker"}, headers=header)
        answer.raise_for_status()
        return answer.json()

    async def _beat(self, control: ClientConnection) -> None:
        """Show a sign of life once a second, and take what comes."""
        while True:
            try:
                async with asyncio.timeout(1.0):
                    async for _ in control:
                        pass
            except TimeoutError:
                await control.send(json.dumps({"type": "beat"}))

    async def _move(self, peer: RTCPeerConnection) -> None:
        view = peer.createDataChannel("view", **NEWEST)
        channel = peer.createDataChannel("keypoints", protocol=self._performer, **NEWEST)
        peer.addTransceiver("video", direction="recvonly")
        await connect(peer, f"{self._address}whep/{self._meeting_id}", self._token)
        sequence, due_s = 0, time.time()
        while not self._end.is_set():
            sequence += 1
            if view.readyState == "open" and sequence % 10 == 1:
                view.send(_listening(sequence))
            data = self._packet(sequence, due_s)
            await asyncio.sleep(max(0.0, due_s + self._found_after_s - time.time()))
            if channel.readyState == "open":
                channel.send(data)
                self._talking.set()
            due_s += 1.0 / RATE_HZ

    def _packet(self, sequence: int, now_s: float) -> bytes:
        expression = neutral()
        expression[_JAW] = float(is_open(now_s - self.first_opening_s))
        xy, world = self._standing
        packet = KeypointsPacket(
            sequence,
            1e3 * now_s,
            *SIZE_PX,
            xy,
            world,
            np.ones(len(xy)),
            ObservedExpression(expression, ALL_GROUPS),
            round(1e3 * self._found_after_s),
        )
        return encode_keypoints(packet)


def _listening(sequence: int) -> bytes:
    """A viewpoint to which no pictures and poses are sent: what answers them is no landmark."""
    packet = ViewPacket(
        sequence, 0.0, (0.0, 1.0, 3.0), (0.0, 1.0, 0.0, 0.0), 0.7, 128, 128, sound_only=True
    )
    return encode_view(packet)
