"""Has a gateway forget whom another process has erased: what it keeps in memory of them, too.

The process that erases somebody forgets them at once; the others look at the rows now and then.
"""

from __future__ import annotations

import asyncio
import logging

from anyio import to_thread

from db.errors import DatabaseError
from services.person_models import ModelCache

log = logging.getLogger(__name__)

LOOK_S = 60.0
"""Between two looks."""


class Forgetting:
    """Of one gateway; every method runs on its event loop."""

    def __init__(self, models: ModelCache) -> None:
        self._models = models
        self._looking: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Look from now on."""
        self._looking = asyncio.create_task(self._look_again_and_again())

    async def close(self) -> None:
        """Look no more."""
        if self._looking is not None:
            self._looking.cancel()
            await asyncio.gather(self._looking, return_exceptions=True)

    async def _look_again_and_again(self) -> None:
        while True:
            await asyncio.sleep(LOOK_S)
            try:
                await to_thread.run_sync(self._models.forget_erased)
            except DatabaseError as error:
                log.warning("who was erased is forgotten later: %s", error)
