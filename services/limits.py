"""How often a caller may ask, and what an address says of who asks."""

from __future__ import annotations

import ipaddress
import math
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from typing import Protocol

from services.errors import TooManyRequests

WINDOW_S = 60.0
_SOON_S = 10
_MOST_KEYS = 10_000
"""Callers remembered before those who have waited long enough are forgotten."""


class SharedCounts(Protocol):
    """How often callers asked all gateways together."""

    def take(self, what: str, caller: str, now_s: float, step_s: float) -> float | None:
        """Count one more of `caller`, each worth `step_s` of a minute. Returns 0, or how many
        seconds it comes too early, and is then not counted; None where nobody knows."""
        ...

    def close(self) -> None: ...


class RateLimit:
    """At most `per_minute` at once, and as many a minute in the long run (GCRA, ITU-T I.371).

    It counts in this process and, where there are `shared` counts, in those: without them, several
    gateways together let in so many times more. Safe to use from several threads; blocks where
    counts are shared.
    """

    def __init__(
        self,
        what: str,
        per_minute: int,
        clock: Callable[[], datetime],
        shared: SharedCounts | None = None,
    ) -> None:
        self._what, self._per_minute, self._clock = what, per_minute, clock
        self._shared = shared
        self._free_s: dict[str, float] = {}
        """When each caller has used nothing up."""
        self._guard = threading.Lock()

    def __len__(self) -> int:
        """How many callers are remembered."""
        return len(self._free_s)

    def take(self, caller: str) -> None:
        """Count one more of `caller`. Raises TooManyRequests beyond the limit."""
        step_s, now_s = WINDOW_S / self._per_minute, self._clock().timestamp()
        wait_s = self._take_here(caller, now_s, step_s)
        if wait_s == 0.0 and self._shared is not None:
            wait_s = self._shared.take(self._what, caller, now_s, step_s) or 0.0
        if wait_s == 0.0:
            return
        raise TooManyRequests(
            f"{self._what} must be at most {self._per_minute} a minute; got one more; "
            f"come back in {math.ceil(wait_s)} s",
            math.ceil(wait_s),
        )

    def _take_here(self, caller: str, now_s: float, step_s: float) -> float:
        """Seconds that it comes too early; 0 where it is counted."""
        with self._guard:
            free_s = max(now_s, self._free_s.get(caller, 0.0)) + step_s
            wait_s = free_s - now_s - WINDOW_S
            if wait_s > 1e-6:
                return wait_s
            self._free_s[caller] = free_s
            self._forget(now_s)
        return 0.0

    def _forget(self, now_s: float) -> None:
        if len(self._free_s) > _MOST_KEYS:
            self._free_s = {key: free for key, free in self._free_s.items() if free > now_s}


class AtOnce:
    """At most so many of a caller at the same time, in this process. For one event loop."""

    def __init__(self, what: str, most: int) -> None:
        self._what, self._most = what, most
        self._held: Counter[str] = Counter()

    def require_room(self, caller: str) -> None:
        """Raise TooManyRequests where the caller holds as many already."""
        if self._held[caller] >= self._most:
            raise TooManyRequests(
                f"{self._what} must be at most {self._most} at once; got one more; end another, or "
                f"come back in {_SOON_S} s",
                _SOON_S,
            )

    @contextmanager
    def held(self, caller: str) -> Iterator[None]:
        """Count one more of the caller meanwhile."""
        self._held[caller] += 1
        try:
            yield
        finally:
            self._held[caller] -= 1
            if not self._held[caller]:
                del self._held[caller]


def network_of(address: str) -> str:
    """What tells one caller from another: an IPv4 address, or the /64 that one IPv6 host has."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:  # a Unix socket, or a test without a network
        return address
    if parsed.version == 4:
        return address
    return str(ipaddress.ip_network((parsed, 64), strict=False))


def is_private(address: str) -> bool:
    """Whether `address` is of this machine or of a private network (RFC 1918, RFC 4193)."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return False
    # IPv4 that comes by an IPv6 socket: Python 3.11 takes all of these for private
    mapped = parsed.ipv4_mapped if isinstance(parsed, ipaddress.IPv6Address) else None
    return (mapped or parsed).is_private
