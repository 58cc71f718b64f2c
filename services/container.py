"""What every part of a process is handed: settings, rows, objects, events, tokens, models, time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from db.objects import Objects
from db.unit_of_work import Database, SqlUnitOfWork
from services.auth import Tokens
from services.identity_provider import IdentityProvider
from services.jobs.events import Events
from services.limits import RateLimit, SharedCounts
from services.person_models import ModelCache
from services.settings import Settings
from services.tickets import Tickets
from services.tracing import Tracing

Clock = Callable[[], datetime]


@dataclass(frozen=True, eq=False)
class Services:
    """One process's view of everything shared."""

    settings: Settings
    database: Database
    objects: Objects
    events: Events
    tokens: Tokens
    models: ModelCache
    tickets: Tickets
    identity_provider: IdentityProvider | None
    """By which people log in, if the settings name one."""
    guest_limit: RateLimit
    login_limit: RateLimit
    account_limit: RateLimit
    address_limit: RateLimit
    """Of requests that need a token, whether theirs is good or not."""
    refusal_limit: RateLimit
    """Of refusals of one caller that the audit log tells."""
    counts: SharedCounts | None
    """Of all gateways, which these limits are held to; None where each counts for itself."""
    tracing: Tracing
    clock: Clock
    describe_failure: Callable[[Exception], dict[str, Any]]
    """What the row of a job keeps of the error that ended it."""

    def unit_of_work(self) -> SqlUnitOfWork:
        """A transaction that may write."""
        return self.database.unit_of_work()

    def reading(self) -> SqlUnitOfWork:
        """A transaction that only reads."""
        return self.database.reading()

    def close(self) -> None:
        """Let go of connections."""
        self.tracing.close()
        self.events.close()
        if self.counts is not None:
            self.counts.close()
        self.database.close()


def utc_now() -> datetime:
    """The time of day, UTC."""
    return datetime.now(UTC)
