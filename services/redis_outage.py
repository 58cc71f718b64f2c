"""Whether Redis is away: told once when it goes and once when it is back."""

from __future__ import annotations

import logging
import time

import redis

log = logging.getLogger(__name__)

PAUSE_S = 2.0
"""Between two attempts while Redis is away, so that one that hangs costs little."""


class Outage:
    """What is known of one client's Redis. Safe to use from several threads."""

    def __init__(self, meanwhile: str) -> None:
        """`meanwhile`: what is done without it, for the log."""
        self._meanwhile = meanwhile
        self._failed_s: float | None = None

    def pauses(self) -> bool:
        """Whether the last failure is so recent that another attempt would fail as well."""
        failed_s = self._failed_s
        return failed_s is not None and time.monotonic() - failed_s < PAUSE_S

    def begin(self, error: redis.RedisError) -> None:
        """It did not answer."""
        if self._failed_s is None:
            log.warning("Redis is away, %s: %s", self._meanwhile, error)
        self._failed_s = time.monotonic()

    def end(self) -> None:
        """It answered."""
        if self._failed_s is not None:
            log.warning("Redis is back, no more %s", self._meanwhile)
        self._failed_s = None
