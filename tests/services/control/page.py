"""A page on the control channel: a plain WebSocket client that says what it is told to."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

import httpx
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

_PATIENCE_S = 20.0


class Page:
    """One channel; keeps every message that came, beats apart."""

    def __init__(self, url: str, token: str, name: str, after: int = 0) -> None:
        self.url, self.token, self.name, self.after = url, token, name, after
        self.heard: list[dict[str, Any]] = []
        self.beats = 0
        self._socket: ClientConnection | None = None
        self._listening: asyncio.Task[None] | None = None
        self._news = asyncio.Condition()
        self.closed = False

    async def __aenter__(self) -> Self:
        self._socket = await connect(self.url)
        self._listening = asyncio.create_task(self._listen())
        await self.say(type="hello", token=self.token, name=self.name, after=self.after)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        assert self._socket is not None
        assert self._listening is not None
        self._socket.transport.abort()  # as when the network goes
        await self._listening

    @property
    def code(self) -> int | None:
        """Of the end (RFC 6455), once the server has closed the channel."""
        return None if self._socket is None else self._socket.close_code

    async def say(self, **message: Any) -> None:
        """Send one message."""
        await self.send(json.dumps(message))

    async def send(self, text: str | bytes) -> None:
        """Send whatever."""
        assert self._socket is not None
        await self._socket.send(text)

    async def beat(self) -> None:
        """One sign of life, until it is answered."""
        before = self.beats
        await self.say(type="beat")
        await self.until(lambda: self.beats > before, "a beat in answer")

    async def hear(self, kind: str, **fields: Any) -> dict[str, Any]:
        """The first message of a kind with these fields, once it has come."""
        return await self.hear_that(
            kind, lambda message: all(message[key] == value for key, value in fields.items())
        )

    async def hear_that(self, kind: str, fits: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first message of a kind that fits, once it has come."""

        def found() -> dict[str, Any] | None:
            fitting = (m for m in self.heard if m["type"] == kind and fits(m))
            return next(fitting, None)

        await self.until(lambda: found() is not None, f"{kind} that fits")
        message = found()
        assert message is not None
        return message

    async def roster(self, fits: Callable[[dict[str, dict[str, Any]]], bool]) -> dict[str, Any]:
        """The members by name, once the newest roster fits."""

        def newest() -> dict[str, dict[str, Any]]:
            rosters = [m for m in self.heard if m["type"] == "roster"]
            return {one["name"]: one for one in rosters[-1]["members"]} if rosters else {}

        await self.until(lambda: bool(newest()) and fits(newest()), "a roster that fits")
        return newest()

    async def gone(self) -> dict[str, Any]:
        """The goodbye, once the server has closed the channel."""
        await self.until(lambda: self.closed, "the end of the channel")
        return self.heard[-1]

    async def _listen(self) -> None:
        assert self._socket is not None
        try:
            async for text in self._socket:
                message = json.loads(text)
                async with self._news:
                    if message["type"] == "beat":
                        self.beats += 1
                    else:
                        self.heard.append(message)
                    self._news.notify_all()
        except ConnectionClosed:
            pass
        async with self._news:
            self.closed = True
            self._news.notify_all()

    async def until(self, fits: Callable[[], bool], what: str) -> None:
        """Wait until `fits`, which is asked at every message."""
        try:
            async with asyncio.timeout(_PATIENCE_S), self._news:
                await self._news.wait_for(fits)
        except TimeoutError as error:
            raise AssertionError(f"{self.name} waited for {what}; heard {self.heard}") from error


async def join(caller: httpx.AsyncClient, meeting_id: str, name: str, **options: Any) -> Page:
    """Take a seat; the page that will sit on it."""
    answer = await caller.post(
        f"/v1/meetings/{meeting_id}/join", json={"display_name": name}, **options
    )
    assert answer.status_code == 200, answer.text
    seat = answer.json()
    return Page(
        f"{caller.base_url!s}".replace("http", "ws", 1).rstrip("/") + seat["control_url"],
        seat["token"],
        name,
    )
