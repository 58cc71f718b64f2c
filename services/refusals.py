"""Has the audit log tell what is refused to whom, wherever that happens, without holding it up."""

from __future__ import annotations

import asyncio
import logging

from fastapi.concurrency import run_in_threadpool

from db.errors import DatabaseError
from services.audit import note_refusal
from services.container import Services
from services.errors import Forbidden, Unauthorized

log = logging.getLogger(__name__)


class Refusals:
    """Of one gateway; every method runs on its event loop."""

    def __init__(self, services: Services) -> None:
        self._services = services
        self._noting: set[asyncio.Task[None]] = set()

    async def note(self, caller: str, account: str, route: str, error: Exception) -> None:
        """As `services.audit.note_refusal`, of errors that say that somebody may not."""
        if not isinstance(error, Forbidden | Unauthorized):
            return
        try:
            await run_in_threadpool(note_refusal, self._services, caller, account, route, error)
        except DatabaseError as away:  # it is refused all the same
            log.warning("the audit log lacks a refusal of %s: %s", route, away)

    def note_soon(self, caller: str, account: str, route: str, error: Exception) -> None:
        """The same; returns at once."""
        noting = asyncio.create_task(self.note(caller, account, route, error))
        self._noting.add(noting)
        noting.add_done_callback(self._noting.discard)

    async def close(self) -> None:
        """Wait for what is being noted."""
        await asyncio.gather(*self._noting, return_exceptions=True)
