"""What every part of a process is handed: settings, rows, objects, events, tokens, models, time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from db.objects import Objects, open_objects
from db.unit_of_work import Database, SqlUnitOfWork
from services.auth import Tokens
from services.jobs.events import Events, open_events
from services.limits import RateLimit
from services.person_models import ModelCache
from services.problems import stored_failure
from services.settings import Settings

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
    guest_limit: RateLimit
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
        self.events.close()
        self.database.close()


def utc_now() -> datetime:
    """The time of day, UTC."""
    return datetime.now(UTC)


def build_services(
    settings: Settings, *, clock: Clock = utc_now, objects: Objects | None = None
) -> Services:
    """Open everything that `settings` name. Neither migrates nor waits for a server."""
    settings.folders.data_dir.mkdir(parents=True, exist_ok=True)
    database = Database(settings.database.url)
    secret = settings.objects.s3_secret_access_key
    store = objects or open_objects(
        settings.objects.store_url,
        endpoint=settings.objects.s3_endpoint_url,
        region=settings.objects.s3_region,
        access_key_id=settings.objects.s3_access_key_id,
        secret_access_key=secret.get_secret_value() if secret else None,
    )
    return Services(
        settings=settings,
        database=database,
        objects=store,
        events=open_events(settings.events.redis_url),
        tokens=Tokens(settings.signing_key(), clock),
        models=ModelCache(database, store, settings.models.max_cached),
        guest_limit=RateLimit(
            "guest tokens from one address", settings.security.guest_tokens_per_minute, clock
        ),
        clock=clock,
        describe_failure=stored_failure,
    )
