"""The server of a gateway that lets its people go elsewhere before it ends."""

from __future__ import annotations

import asyncio
import signal
from types import FrameType
from typing import Any

import uvicorn
from fastapi import FastAPI

from services.control.messages import LONGEST_MESSAGE_BYTES
from services.gateway import Gateway

_BYTES_A_CHARACTER = 4
"""Of UTF-8, at most."""


def gateway_config(app: FastAPI, **changes: Any) -> uvicorn.Config:
    """How a gateway's application is served."""
    options: dict[str, Any] = {
        "log_config": None,  # its lines look like ours
        "log_level": "warning",
        "access_log": False,  # addresses of requests hold ids of meetings
        "timeout_graceful_shutdown": 5,
        "lifespan": "on",
        # 32 messages of each connection wait to be read, of whoever has no token, too
        "ws_max_size": _BYTES_A_CHARACTER * LONGEST_MESSAGE_BYTES,
    }
    return uvicorn.Config(app, **(options | changes))


class DrainingServer(uvicorn.Server):
    """Told to end by SIGTERM, it drains first; by SIGINT, or a second time, it ends at once."""

    def __init__(self, config: uvicorn.Config, gateway: Gateway, drain_s: float) -> None:
        super().__init__(config)
        self._gateway, self._drain_s = gateway, drain_s
        self._loop: asyncio.AbstractEventLoop | None = None
        self._draining: asyncio.Task[None] | None = None

    async def startup(self, sockets: Any = None) -> None:
        """Listen; from here on there is somebody to let go."""
        self._loop = asyncio.get_running_loop()
        await super().startup(sockets)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End, sooner or later."""
        if self._loop is None or sig != signal.SIGTERM or self._draining is not None:
            super().handle_exit(sig, frame)
            return
        self._loop.call_soon_threadsafe(self._begin_to_drain, sig)

    def _begin_to_drain(self, sig: int) -> None:
        self._draining = asyncio.create_task(self._drain(sig))

    async def _drain(self, sig: int) -> None:
        try:
            await self._gateway.drain(self._drain_s)
        finally:
            super().handle_exit(sig, None)
