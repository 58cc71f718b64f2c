"""One person of a load test: the page's way into a meeting, without a page.

They take a seat, open the control channel and a view by WHEP, say that they draw the room
themselves, send 30 poses a second as a page solves them, and take everybody's. Nothing is drawn.

A motion's number travels where a page says how old its picture was (`SolvedMotion.age_ms`): the
server hands that on unchanged with the pose that it sends, so that whoever receives it knows when
it was sent, on any server and by one clock.
"""

from __future__ import annotations

import asyncio
import json
import struct
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from urllib.parse import urljoin

import httpx
from aiortc import (
    RTCConfiguration,
    RTCDataChannel,
    RTCIceServer,
    RTCPeerConnection,
    RTCSessionDescription,
)
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as connect_socket
from websockets.exceptions import WebSocketException

from benchmarks.load.tally import Tally
from services.live.packets import BATCHES, HEADER, ViewPacket, encode_view, packets_of

RATE_HZ = 30
_NEWEST = {"ordered": False, "maxRetransmits": 0}
_POSE = struct.Struct(HEADER.format + "B")
"""A pose packet's header and whose it is."""
_NUMBERS = 0x7FFF
"""Motions are told apart by so many numbers, from 1."""
_REMEMBERED = 1024
"""Motions whose sending is remembered: half a minute's."""
_RESTING_S = 0.4
"""Between two viewpoints of somebody who stands still."""
_BEAT_S = 1.0
_LOST_S = 5.0
"""Without a pose for so long a browser finds the connection lost."""
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 8.0
"""Between attempts to connect, as the page's."""
_LONGEST_AWAY_S = 1.0
"""While nobody answers: a page's control channel tries so often, and its picture follows."""


@dataclass(eq=False)
class SharedMeeting:
    """What the people of one meeting, all of one process, know together."""

    addresses: Sequence[str]
    """Of the gateways that serve it. Each person asks another first, as at a load balancer that
    knows nobody, and goes where they are sent."""
    meeting_id: str
    performer_ids: Sequence[str]
    sent_s: dict[int, list[float]] = field(default_factory=dict)
    """By performer: when each of the last motions was sent."""

    def __post_init__(self) -> None:
        self.sent_s = {index: [0.0] * _REMEMBERED for index in range(len(self.performer_ids))}


class Refused(Exception):
    """The server lets nobody in now."""

    def __init__(self, answer: httpx.Response) -> None:
        super().__init__(f"{answer.status_code}: {answer.text[:200]}")
        self.status = answer.status_code
        self.retry_after_s = float(answer.headers.get("Retry-After", 0.0))

    @property
    def told(self) -> str:
        """The status, and whether it said when to come back."""
        return f"{self.status} Retry-After" if self.retry_after_s else str(self.status)


class Person:
    """Somebody who moves one performer of a meeting, and sees all."""

    def __init__(
        self,
        caller: httpx.AsyncClient,
        meeting: SharedMeeting,
        index: int,
        motions: Sequence[bytes],
        phase: float,
    ) -> None:
        """Performer `index` moves by `motions`, `phase` (0 to 1) of a tick after the others."""
        self._caller, self._meeting, self._index = caller, meeting, index
        self._motions, self._phase = motions, phase
        self._peer: RTCPeerConnection | None = None
        self._task: asyncio.Task[None] | None = None
        self._seat: tuple[str, dict] | None = None
        """The gateway's address and what it gave; kept while only a view is refused."""
        self._cut = asyncio.Event()
        self._away_until_s = 0.0
        self._number = 0
        self._newest: dict[int, int] = {}
        self._tick: int | None = None
        self._started_s = self._opened_s = time.monotonic()
        self.moved_s = time.monotonic()
        """When anybody moved last."""
        self.connected = asyncio.Event()
        """Set while somebody is seen to move."""
        self.sees_all = asyncio.Event()
        """Set once everybody is seen to move on one connection."""
        self._seen: set[int] = set()
        self.tally = Tally()
        self._new = 0
        self._gap_s = 0.0

    def start(self) -> None:
        """Come in, and come back whenever the connection is lost, until `leave`."""
        self._task = asyncio.create_task(self._run())

    async def leave(self) -> None:
        """Go, at once."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])

    def cut(self, away_s: float) -> None:
        """Lose the network without a word, for so long."""
        self._away_until_s = time.monotonic() + away_s
        self._cut.set()
        if self._peer is not None:
            drop_sockets(self._peer)

    def collect(self) -> Tally:
        """What was counted since the last time."""
        now_s, tally = time.monotonic(), self.tally
        performers = len(self._meeting.performer_ids)
        tally.viewer_rates = [self._new / performers / (now_s - self._started_s)]
        # a gap that has not ended yet counts too
        tally.longest_gaps_s = [max(self._gap_s, now_s - self.moved_s)]
        self.tally, self._new, self._gap_s = Tally(), 0, 0.0
        self._started_s = now_s
        return tally

    async def _run(self) -> None:
        attempt = 0
        while True:
            pause_s = min(_LONGEST_PAUSE_S, _FIRST_PAUSE_S * 2**attempt)
            try:
                await self._visit()
                attempt, pause_s = 0, _FIRST_PAUSE_S
                self._seat = None
            except Refused as refusal:
                self.tally.answers[refusal.told] += 1
                if refusal.status != 503:
                    self._seat = None
                pause_s = max(pause_s, refusal.retry_after_s)
            except (httpx.TransportError, OSError, TimeoutError, WebSocketException):
                self.tally.answers["away"] += 1
                self._seat, pause_s = None, min(pause_s, _LONGEST_AWAY_S)
            finally:
                self.connected.clear()
                self.sees_all.clear()
                self._seen.clear()
            attempt += 1
            away_s = self._away_until_s - time.monotonic()
            if away_s > 0.0:
                # a browser tells its pages when the network is back
                attempt, pause_s = 0, away_s
            await asyncio.sleep(pause_s)

    async def _visit(self) -> None:
        """One connection, until it is lost."""
        address, seat = self._seat = self._seat or await self._join()
        url = urljoin(address, seat["control_url"]).replace("http", "ws", 1)
        peer = RTCPeerConnection(
            RTCConfiguration(iceServers=[RTCIceServer(**one) for one in seat["ice_servers"]])
        )
        self._peer = peer
        self._cut.clear()
        try:
            async with connect_socket(url) as socket:
                hello = {"type": "hello", "token": seat["token"], "name": "Load", "after": 0}
                await socket.send(json.dumps(hello))
                location, channels = await self._open(peer, address, seat)
                try:
                    async with asyncio.TaskGroup() as tasks:
                        tasks.create_task(_discard(socket))
                        tasks.create_task(_beat(socket))
                        tasks.create_task(self._look(channels["view"]))
                        tasks.create_task(self._move(channels["motion"]))
                        tasks.create_task(self._until_lost(peer))
                finally:
                    if self._cut.is_set():
                        socket.transport.abort()
                    else:
                        await self._say_goodbye(location, seat["token"])
        except* _Lost:
            pass
        except* WebSocketException:
            pass
        finally:
            await peer.close()

    async def _join(self) -> tuple[str, dict]:
        """A seat, and the address of the gateway that the meeting lives on."""
        at = self._index % len(self._meeting.addresses)
        path = f"/v1/meetings/{self._meeting.meeting_id}/join"
        away: httpx.TransportError | None = None
        for address in (*self._meeting.addresses[at:], *self._meeting.addresses[:at]):
            try:
                answer = await self._caller.post(address + path, json={"display_name": "Load"})
            except httpx.TransportError as error:
                away = error
                continue
            if answer.status_code != 200:
                raise Refused(answer)
            seat = answer.json()
            return seat["gateway_url"] or address, seat
        raise away or httpx.TransportError("no gateway has an address")

    async def _open(
        self, peer: RTCPeerConnection, address: str, seat: dict
    ) -> tuple[str, dict[str, RTCDataChannel]]:
        """A view: where it ends, and its channels."""
        protocols = {
            "view": "",
            "pose": BATCHES,
            "motion": self._meeting.performer_ids[self._index],
        }
        channels = {
            name: peer.createDataChannel(name, protocol=protocol, **_NEWEST)
            for name, protocol in protocols.items()
        }
        channels["pose"].on("message", self._on_poses)
        peer.addTransceiver("video", direction="recvonly")
        await peer.setLocalDescription(await peer.createOffer())
        answer = await self._caller.post(
            urljoin(address, seat["whep_url"]),
            content=peer.localDescription.sdp,
            headers={
                "Authorization": f"Bearer {seat['token']}",
                "Content-Type": "application/sdp",
            },
        )
        if answer.status_code != 201:
            raise Refused(answer)
        self.tally.answers["201"] += 1
        self._tick, self._opened_s = None, time.monotonic()
        await peer.setRemoteDescription(RTCSessionDescription(answer.text, "answer"))
        return address + answer.headers["Location"], channels

    async def _say_goodbye(self, location: str, token: str) -> None:
        header = {"Authorization": f"Bearer {token}"}
        with suppress(httpx.HTTPError):
            await self._caller.delete(location, headers=header)

    async def _look(self, channel: RTCDataChannel) -> None:
        sequence = 0
        while True:
            if channel.readyState == "open":
                sequence += 1
                channel.send(_viewpoint(sequence))
            await asyncio.sleep(_RESTING_S if sequence else 0.02)

    async def _move(self, channel: RTCDataChannel) -> None:
        sent_s = self._meeting.sent_s[self._index]
        due_s = time.monotonic() + self._phase / RATE_HZ
        while True:
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
            due_s = max(due_s + 1.0 / RATE_HZ, time.monotonic())
            if channel.readyState != "open":
                continue
            self._number += 1
            number = 1 + self._number % _NUMBERS
            data = bytearray(self._motions[self._number % len(self._motions)])
            version, kind, *_ = HEADER.unpack_from(data)
            now_s = time.monotonic()
            HEADER.pack_into(data, 0, version, kind, number, self._number, 1e3 * now_s)
            sent_s[number % _REMEMBERED] = now_s
            channel.send(bytes(data))
            self.tally.sent += 1

    def _on_poses(self, message: object) -> None:
        if not isinstance(message, bytes):
            return
        now_s = time.monotonic()
        self.tally.bytes_received += len(message)
        for packet in packets_of(message):
            _, _, number, tick, _, index = _POSE.unpack_from(packet)
            self._on_pose(number, tick, index, now_s)

    def _on_pose(self, number: int, tick: int, index: int, now_s: float) -> None:
        tally = self.tally
        tally.received += 1
        if self._tick is None or tick > self._tick:
            ticks = 1 if self._tick is None else tick - self._tick
            tally.expected += ticks * len(self._meeting.performer_ids)
            self._tick = tick
        last = self._newest.get(index, 0)
        if not number or not 0 < (number - last) % _NUMBERS < _NUMBERS // 2:
            return
        self._newest[index] = number
        tally.relay_s.append(now_s - self._meeting.sent_s[index][number % _REMEMBERED])
        self._new += 1
        self._gap_s = max(self._gap_s, now_s - self.moved_s)
        self.moved_s = now_s
        self.connected.set()
        self._seen.add(index)
        if len(self._seen) == len(self._meeting.performer_ids):
            self.sees_all.set()

    async def _until_lost(self, peer: RTCPeerConnection) -> None:
        """Raises _Lost as soon as a browser would find the connection lost."""
        while peer.connectionState not in ("failed", "closed") and not self._cut.is_set():
            await asyncio.sleep(0.1)
            if time.monotonic() - max(self.moved_s, self._opened_s) > _LOST_S:
                break
        raise _Lost


def drop_sockets(peer: RTCPeerConnection) -> None:
    """Drop a connection's sockets: nothing is said to the other side."""
    transports = {one.receiver.transport.transport for one in peer.getTransceivers()}
    for transport in transports:
        for protocol in transport._connection._protocols:
            protocol.transport.abort()


class _Lost(Exception):
    """The connection is no more."""


async def _discard(socket: ClientConnection) -> None:
    """Read what the control channel says, to no end but its own."""
    async for _ in socket:
        pass
    raise _Lost


async def _beat(socket: ClientConnection) -> None:
    while True:
        await socket.send('{"type": "beat"}')
        await asyncio.sleep(_BEAT_S)


def _viewpoint(sequence: int) -> bytes:
    """Of somebody who draws by themselves."""
    return encode_view(
        ViewPacket(
            sequence, 0.0, (0.0, 1.0, 3.0), (0.0, 1.0, 0.0, 0.0), 0.7, 512, 512, draws_itself=True
        )
    )
