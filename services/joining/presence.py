"""Somebody in a meeting without a page, wherever it lives: they follow as it moves.

A gateway that drains ends their connection and keeps their seat; one that died is silent, and the
meeting's home is another once its lease has run out (services.homes). Either way the token of the
seat opens a connection at the next home, as a page's does.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import httpx

from scene.arrays import Array, UInt8
from services.joining.member import MeetingMember
from services.joining.seat import MeetingAway, NotJoined, Seat, refusal
from services.live.keypoints_packet import KeypointsPacket

_LOOK_S = 0.2
"""Between looks at the connection."""
_ASK_S = 2.0
"""Between questions where the meeting lives: a gateway that died says nothing."""
_CLOSES_S = 2.0
"""In which a home that is one no more ends the connection, if it lives: so the seat stays."""
_RETRY_S = 0.5
_PATIENCE_S = 30.0
"""A seat is kept for so long."""
_ANSWER_S = 5.0


class Presence:
    """Drives one performer, over one connection after another; on one event loop."""

    def __init__(self, seat: Seat, *, live_look: bool) -> None:
        self._seat, self._live_look = seat, live_look
        self._member = MeetingMember(seat, seat.gateway_url, live_look=live_look)
        self._ended: NotJoined | None = None
        self.home = seat.gateway_url
        """Where the meeting lives, as far as is known; empty: at the server."""

    def send(self, packet: KeypointsPacket) -> bool:
        """Send what the webcam saw, if it can go out at once; says whether it did.

        Raises NotJoined once the meeting has refused, or could not be found again.
        """
        if self._ended is not None:
            raise self._ended
        return self._member.send(packet)

    def show(self, picture: UInt8[Array, "528 384 3"]) -> None:
        """Send a picture for live look, if that is on."""
        if self._member.look is not None:
            self._member.look.show(picture)

    async def connect(self) -> None:
        """Be in the meeting for the first time. Raises NotJoined."""
        await self._member.connect()

    async def leave(self) -> None:
        """Give the seat back."""
        await self._member.leave()

    async def follow(self) -> None:
        """Stay in the meeting, until it refuses or is found no more."""
        asked_s = time.monotonic()
        while True:
            await asyncio.sleep(_LOOK_S)
            if self._member.is_cut_off:
                await self._come_again()
            elif time.monotonic() - asked_s > _ASK_S:
                if await self._has_moved():
                    await self._be_sent_away()
                    await self._come_again()
                asked_s = time.monotonic()

    async def _has_moved(self) -> bool:
        try:
            return await self._ask_home() != self.home
        except NotJoined:
            return False

    async def _be_sent_away(self) -> None:
        deadline_s = time.monotonic() + _CLOSES_S
        while not self._member.is_cut_off and time.monotonic() < deadline_s:
            await asyncio.sleep(_LOOK_S)

    async def _come_again(self) -> None:
        await self._member.close()
        deadline_s = time.monotonic() + _PATIENCE_S
        while True:
            try:
                home = await self._ask_home()
                self._member = MeetingMember(self._seat, home, live_look=self._live_look)
                await self._member.connect()
                self.home = home
                return
            except NotJoined as error:
                await self._member.close()
                if not isinstance(error, MeetingAway) or time.monotonic() > deadline_s:
                    self._ended = error
                    raise
                await asyncio.sleep(_RETRY_S)

    async def _ask_home(self) -> str:
        """Where the meeting lives now. Raises NotJoined, MeetingAway."""
        path = f"/v1/meetings/{self._seat.meeting_id}/home"
        header = {"Authorization": f"Bearer {self._seat.token}"}
        known = dict.fromkeys((self._seat.server, self.home or self._seat.server))
        async with httpx.AsyncClient(headers=header, timeout=_ANSWER_S) as caller:
            for server in known:
                try:
                    answer = await caller.get(server + path)
                except httpx.TransportError:
                    continue
                if not answer.is_success:
                    raise refusal(answer)
                return str(answer.json()["gateway_url"])
        raise MeetingAway(f"the meeting's server must answer; got nothing from {list(known)}")


@asynccontextmanager
async def present(seat: Seat, *, live_look: bool) -> AsyncIterator[Presence]:
    """In the meeting, from connecting to leaving. Raises NotJoined."""
    made = Presence(seat, live_look=live_look)
    following: asyncio.Task[None] | None = None
    try:
        await made.connect()
        following = asyncio.create_task(made.follow())
        yield made
    finally:
        if following is not None:
            following.cancel()
            await asyncio.gather(following, return_exceptions=True)
        await made.leave()
