"""What a gateway needs, what it can do without for a while, and whether it is there.

Rows and bytes are needed for every request. Redis carries only what may be lost: without it a
gateway is slower to notice what others did, and sending its users elsewhere would help nobody.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Literal

from db.errors import DatabaseError
from services.container import Services

OK = "ok"
"""The state of what answers; of what does not, it is the reason."""
_DISPENSABLE = frozenset({"redis"})
PATIENCE_S = 4.0
"""A store that hangs must be named while the probe still waits."""

Status = Literal["ready", "degraded", "unready"]


def check_stores(services: Services) -> dict[str, str]:
    """`ok`, or why not, of database, object store and, where it is configured, Redis."""
    pings: dict[str, Callable[[], None]] = {
        "database": services.database.ping,
        "objects": services.objects.ping,
    }
    if services.settings.events.redis_url:
        pings["redis"] = services.events.ping
    states = dict.fromkeys(pings, f"no answer in {PATIENCE_S:g} s")

    def look(name: str) -> None:
        states[name] = _state(pings[name])

    looks = [threading.Thread(target=look, args=[name], daemon=True) for name in pings]
    give_up_s = time.monotonic() + PATIENCE_S
    for one in looks:
        one.start()
    for one in looks:
        one.join(max(0.0, give_up_s - time.monotonic()))
    return dict(states)  # a copy, which an answer that comes late leaves alone


def status_of(checks: dict[str, str]) -> Status:
    """What the states of `check_stores` mean for the whole process."""
    away = {name for name, state in checks.items() if state != OK}
    if not away:
        return "ready"
    return "degraded" if away <= _DISPENSABLE else "unready"


def _state(ping: Callable[[], None]) -> str:
    try:
        ping()
    except (DatabaseError, ConnectionError) as error:
        return str(error)
    return OK
