"""A span for each request; installed only where traces are on."""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.tracing import Tracing

_TRACED = ("/v1/", "/whep/", "/whip/")
"""Beginnings of traced paths: neither the page's files nor what machines ask every second."""


class TraceRequests:
    """ASGI middleware. A caller's own trace is gone on with (`traceparent`, W3C Trace Context)."""

    def __init__(self, app: ASGIApp, tracing: Tracing) -> None:
        self._app, self._tracing = app, tracing

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or not scope["path"].startswith(_TRACED):
            await self._app(scope, receive, send)
            return
        method = scope["method"]
        parent = Headers(scope=scope).get("traceparent")
        with self._tracing.span(
            method, parent=parent, serves=True, attributes={"http.request.method": method}
        ) as tell:

            async def note(message: Message) -> None:
                if message["type"] == "http.response.start":
                    tell("http.response.status_code", message["status"])
                await send(message)

            try:
                await self._app(scope, receive, note)
            finally:
                # the pattern alone: ids are invitations, and make a name each
                route = getattr(scope.get("route"), "path", "other")
                tell("http.route", route)
                tell("name", f"{method} {route}")
