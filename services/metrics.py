"""Figures for Prometheus: requests by route, jobs by state, and what live sessions add."""

from __future__ import annotations

import time

from prometheus_client import Counter, Gauge, Histogram, generate_latest
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from db.errors import DatabaseError
from db.models import JobKind, JobState
from services.container import Services
from services.gateway import Gateway
from services.process_figures import describe_process
from services.readiness import OK, check_stores

REQUESTS = Counter("metanerf_requests_total", "Answered requests.", ["method", "route", "status"])
SECONDS = Histogram(
    "metanerf_request_seconds",
    "Time from request to answer, s.",
    ["route"],
    buckets=(0.005, 0.02, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 10, 60),
)
JOBS = Gauge("metanerf_jobs", "Jobs by kind and state.", ["kind", "state"])
VIEWERS = Gauge("metanerf_viewers", "Viewers served live now.")
RENDER_MS = Gauge("metanerf_render_milliseconds", "Median of the latest renders, ms.")
PARTICIPANTS = Gauge("metanerf_participants", "Pages on the control channel now.")
VOICES = Gauge("metanerf_voices", "Voice connections now.")
MEETINGS = Gauge("metanerf_meetings", "Meetings that somebody watches here now.")
STORES = Gauge("metanerf_store_up", "1 where a store answers, else 0.", ["store"])


class CountRequests:
    """ASGI middleware: counts and times what is answered, streams left as they are."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        started, status = time.perf_counter(), 500

        async def note(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, receive, note)
        finally:
            # the route's pattern, not the path: ids would make a series each
            route = getattr(scope.get("route"), "path", "other")
            REQUESTS.labels(scope["method"], route, str(status)).inc()
            SECONDS.labels(route).observe(time.perf_counter() - started)


def measure(gateway: Gateway) -> None:
    """Have the figures of live sessions read from `gateway` whenever they are asked for."""
    describe_process(gateway.services.settings.server.log_style.node_id)
    VIEWERS.set_function(lambda: len(gateway.views))
    VOICES.set_function(lambda: len(gateway.voices))
    MEETINGS.set_function(lambda: gateway.views.meetings)
    RENDER_MS.set_function(lambda: _median(gateway.views.render_milliseconds()))
    PARTICIPANTS.set_function(lambda: len(gateway.hub))


def exposition(services: Services) -> bytes:
    """Everything, in Prometheus' text format."""
    try:
        with services.reading() as unit:
            counts = unit.jobs.count()
    except DatabaseError:  # the other figures are wanted all the more then
        counts = {}
    for store, state in check_stores(services).items():
        STORES.labels(store).set(state == OK)
    for kind in JobKind:
        for state in JobState:
            JOBS.labels(kind.value, state.value).set(counts.get((kind, state), 0))
    return generate_latest()


def _median(values: list[float]) -> float:
    ordered = sorted(values)
    return ordered[len(ordered) // 2] if ordered else 0.0
