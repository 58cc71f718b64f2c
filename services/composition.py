"""Builds a process's services from its settings: the composition root."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from db.objects import Objects, open_objects
from db.unit_of_work import Database
from scene.errors import InvalidInput
from services.auth import Tokens
from services.container import Clock, Services, utc_now
from services.identity_provider import IdentityProvider
from services.jobs.events import Events, LocalEvents
from services.limits import RateLimit, SharedCounts
from services.person_models import ModelCache
from services.settings import Settings
from services.tickets import Tickets
from services.tracing import Tracing
from services.tracing_settings import TracingSettings

if TYPE_CHECKING:  # jobs do without what is live
    from collections.abc import Callable

    from services.live.rendering.homes import RendererHome
    from services.live.streaming.pictures import Renderers


_NOTED_A_MINUTE = 10


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
        public_endpoint=settings.objects.s3_public_url,
        region=settings.objects.s3_region,
        access_key_id=settings.objects.s3_access_key_id,
        secret_access_key=secret.get_secret_value() if secret else None,
    )
    keys, counts = settings.signing_keys(), open_counts(settings.events.redis_url)
    return Services(
        settings=settings,
        database=database,
        objects=store,
        events=open_events(settings.events.redis_url),
        tokens=Tokens(keys, clock),
        tickets=Tickets(keys, clock),
        identity_provider=IdentityProvider(settings.login) if settings.login.issuer else None,
        models=ModelCache(database, store, settings.models.max_cached),
        guest_limit=RateLimit(
            "guest tokens from one address",
            settings.security.guest_tokens_per_minute,
            clock,
            counts,
        ),
        login_limit=RateLimit(
            "logins from one address", settings.security.guest_tokens_per_minute, clock, counts
        ),
        account_limit=RateLimit(
            "requests of one account", settings.quotas.requests_per_minute, clock, counts
        ),
        address_limit=RateLimit(
            "requests from one address", settings.quotas.requests_per_address, clock, counts
        ),
        refusal_limit=RateLimit(
            "refusals of one caller that are noted", _NOTED_A_MINUTE, clock, counts
        ),
        counts=counts,
        tracing=open_tracing(settings.tracing),
        clock=clock,
        describe_failure=_described,
    )


def _described(error: Exception) -> dict[str, Any]:
    from services.problems import (
        stored_failure,  # here, for jobs do without FastAPI until one fails
    )

    return stored_failure(error)


def open_events(redis_url: str | None) -> Events:
    """Events by Redis where there is one, else within this process."""
    if not redis_url:
        return LocalEvents()
    from services.jobs.redis_events import RedisEvents  # here, for Redis' client loads slowly

    return RedisEvents(redis_url)


def open_counts(redis_url: str | None) -> SharedCounts | None:
    """Counts of requests that gateways share, by Redis where there is one."""
    if not redis_url:
        return None
    from services.redis_counts import RedisCounts  # here, for Redis' client loads slowly

    return RedisCounts(redis_url)


def open_tracing(settings: TracingSettings) -> Tracing:
    """As `settings` say. Raises InvalidInput where OpenTelemetry is wanted and not installed."""
    if not settings.endpoint:
        return Tracing()
    if find_spec("opentelemetry") is None or find_spec("opentelemetry.sdk") is None:
        raise InvalidInput(
            "OpenTelemetry must be installed for METANERF_OTLP_ENDPOINT; got a Python without it; "
            "install it with `pip install '.[tracing]'`, or unset the variable"
        )
    from services.otlp import OtlpTracing

    return OtlpTracing(settings.endpoint)


def open_renderers(settings: Settings, clock: Callable[[], float]) -> Renderers:
    """What draws for viewers, by the view sessions' `clock`. Raises InvalidInput where Ray is
    wanted and not installed."""
    live = settings.live
    if live.renderers == "here":
        from services.live.rendering.here import RenderersHere

        return RenderersHere(clock)
    from services.live.rendering.pool import RendererPool

    home = _open_ray_home(settings) if live.renderers == "ray" else _open_process_home(settings)
    return RendererPool(
        home,
        clock,
        most=live.renderer_count,
        viewers_each=live.renderer_viewers,
        idle_s=live.renderer_idle_s,
    )


def _open_process_home(settings: Settings) -> RendererHome:
    from services.live.rendering.processes import ProcessHome

    return ProcessHome(settings.live.renderer_count, settings.server.log_style)


def _open_ray_home(settings: Settings) -> RendererHome:
    require_ray("METANERF_RENDERERS=ray")
    from services.live.rendering.ray_home import RayHome

    return RayHome(settings.cluster.ray_address, settings.cluster.renderer_resources)


def require_ray(wanted_for: str) -> None:
    """Raises InvalidInput where Ray is not installed."""
    if find_spec("ray") is None:
        raise InvalidInput(
            f"Ray must be installed for {wanted_for}; got a Python without it; "
            "install it with `pip install '.[cluster]'`"
        )
