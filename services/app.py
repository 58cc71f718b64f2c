"""The gateway: `create_app(services)` gives a FastAPI application with everything mounted."""

from __future__ import annotations

import logging
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from typing import Any

from fastapi import FastAPI, Request
from fastapi.concurrency import run_in_threadpool
from starlette.types import ASGIApp

from db.models import JobKind
from services import metrics, problems
from services.api import (
    access,
    consents,
    control_channel,
    description,
    environments,
    jobs,
    landmarks,
    login,
    meetings,
    models,
    operation,
    people,
    recordings,
    sequences,
    uploads,
)
from services.api.body_limit import LimitBodies
from services.api.dependencies import network_of_caller
from services.api.signalling import kept_frames, voice, whep, whip
from services.container import Services
from services.content_policy import ClosedByDefault
from services.control import messages
from services.cross_origin import AllowOrigins
from services.gateway import build_gateway, gateway_of
from services.jobs.local_engine import LocalEngine
from services.jobs.worker import Worker
from services.logs import IdentifyRequests
from services.page import page_route
from services.refusals import Refusals
from services.traced_requests import TraceRequests

log = logging.getLogger(__name__)

ROUTERS = (
    access.router,
    login.router,
    people.router,
    consents.router,
    uploads.router,
    sequences.router,
    jobs.router,
    models.router,
    environments.router,
    meetings.router,
    recordings.router,
    landmarks.router,
    operation.router,
    description.router,
    whep.router,
    kept_frames.router,
    voice.router,
    whip.router,
    control_channel.router,
)
"""Every route of the gateway, in the order in which the API's description lists them."""

_TAGS = [
    {"name": "access", "description": "Tokens."},
    {"name": "people", "description": "Persons, and erasing them."},
    {"name": "sequences", "description": "Clips: upload, capture, train from them."},
    {"name": "jobs", "description": "Long work: follow, cancel, resume."},
    {"name": "models", "description": "Trained models: files and views."},
    {"name": "environments", "description": "Places to meet in, and their light."},
    {"name": "meetings", "description": "Rooms: open, join, who stands where."},
    {"name": "recordings", "description": "Meetings shown again: motion, voices, words."},
    {"name": "operation", "description": "Health, readiness, figures."},
]
_ABOUT = (
    "One camera per person, a neural model of each person, and a meeting in which every viewer "
    "chooses where to stand. Errors are problems (RFC 9457) that say the rule, the value received "
    "and how to mend it."
)


class _Application(FastAPI):
    def openapi(self) -> dict[str, Any]:
        """The API's description, with the control channel's messages: OpenAPI has WebSockets no
        place of their own, so they stand among the schemas as `ToServer` and `FromServer`."""
        document = super().openapi()
        schemas = document["components"]["schemas"]
        for name, schema in messages.schemas().items():
            schemas.setdefault(name, schema)
        return document

    def build_middleware_stack(self) -> ASGIApp:
        """FastAPI's, with a policy and an id on every answer, also where no route is known."""
        return IdentifyRequests(ClosedByDefault(super().build_middleware_stack()))


def create_app(services: Services) -> FastAPI:
    """The gateway over `services`, which it closes when it ends.

    The database is migrated, and work begins, when it starts.
    """
    app = _Application(
        title="MetaNeRF",
        version="1",
        description=_ABOUT,
        openapi_tags=_TAGS,
        lifespan=_lifespan,
        docs_url=None,  # services.api.description is in its place
        redoc_url=None,
        separate_input_output_schemas=False,
    )
    settings = services.settings
    gateway = build_gateway(services)
    app.state.gateway = gateway
    metrics.measure(gateway)
    problems.install(app, partial(_note_refusal, gateway.refusals))
    app.add_middleware(LimitBodies)
    app.add_middleware(metrics.CountRequests)
    if services.tracing.on:
        app.add_middleware(TraceRequests, tracing=services.tracing)
    if settings.server.allowed_origins or settings.server.gateway_url:
        app.add_middleware(
            AllowOrigins, always=settings.server.allowed_origins, known=gateway.homes.origins
        )
    for router in ROUTERS:
        app.include_router(router)
    app.router.routes.append(page_route(settings.server.client_dir, gateway.homes.origins))
    return app


async def _note_refusal(refusals: Refusals, request: Request, error: Exception) -> None:
    """Have the audit log tell it, but for requests that bring no token at all."""
    account = getattr(request.state, "account", "")
    if not account and "authorization" not in request.headers:
        return
    # the pattern alone: a meeting's id is its invitation
    route = f"{request.method} {getattr(request.scope.get('route'), 'path', '')}"
    await refusals.note(account or network_of_caller(request), account, route, error)


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    gateway = gateway_of(app)
    services = gateway.services
    await run_in_threadpool(services.database.migrate)
    gateway.begin()
    stop = threading.Event()
    worker = None
    if services.settings.jobs.embedded_worker:
        kinds = [JobKind(kind) for kind in services.settings.jobs.worker_kinds]
        run = Worker(services, kinds, LocalEngine(services.settings)).run
        worker = threading.Thread(target=run, args=(stop,), name="worker", daemon=True)
        worker.start()
    try:
        yield
    finally:
        stop.set()
        await gateway.close()
        if worker is not None:
            await run_in_threadpool(worker.join)
        services.close()
