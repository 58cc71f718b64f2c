"""Lines of a process's log: for people, or as JSON with the ids of what each is about.

A request's id comes with it (`X-Request-Id`) or is made, and is sent back; what a request starts,
in threads and tasks, has its id as well. A token is a key, and a meeting's id is its invitation: no
line holds either. A meeting stands there as a digest, which whoever knows its id can make.
"""

from __future__ import annotations

import hashlib
import json
import logging
import re
import secrets
import sys
from collections.abc import Callable, MutableMapping
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:  # jobs do without HTTP
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

_HEADER = b"x-request-id"
_WELL_FORMED = re.compile(r"[A-Za-z0-9._-]{1,64}")
_SECRETS = re.compile(r"eyJ[\w-]+\.[\w-]+\.[\w-]*|(?<=[?&]token=)[^&\s\"']+|(?<=Bearer )\S+")
"""Signed tokens, and what an address or a header says is one."""
_ANSWERS = ("http.response.start", "websocket.accept", "websocket.http.response.start")
_CHATTY = ("aioice", "aiortc", "alembic", "httpcore", "httpx")
"""At the level `debug` they log every packet, request and look at the schema."""


class _Asked(NamedTuple):
    request_id: str
    scope: MutableMapping[str, Any]
    """Of ASGI; what is in the path is known once a route was found."""


_asked: ContextVar[_Asked | None] = ContextVar("asked", default=None)


class LogStyle(NamedTuple):
    """How a process logs."""

    format: str
    """`text` or `json`."""
    level: str
    node_id: str


def configure(
    style: LogStyle, *, job_id: str | None = None, trace: Callable[[], str | None] = lambda: None
) -> None:
    """Have this process log so, to its standard error. `trace` tells the `traceparent`, if any."""
    handler = logging.StreamHandler(sys.stderr)
    if style.format == "json":
        always = {"node_id": style.node_id} | ({"job_id": job_id} if job_id else {})
        handler.setFormatter(_AsJson(always, trace))
        logging.captureWarnings(True)
        sys.excepthook = lambda *about: logging.critical("the process ends", exc_info=about)
    else:
        handler.setFormatter(_AsText("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=style.level.upper(), handlers=[handler])
    for chatty in _CHATTY:
        logging.getLogger(chatty).setLevel(logging.WARNING)


def meeting_digest(meeting_id: str) -> str:
    """By which a meeting is known in logs: twelve hexadecimal digits of its id's SHA-256."""
    return hashlib.sha256(meeting_id.encode()).hexdigest()[:12]


class IdentifyRequests:
    """ASGI middleware: outermost, so that answers to what nobody foresaw have an id, too."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        given = dict(scope["headers"]).get(_HEADER, b"").decode("latin-1")
        request_id = given if _WELL_FORMED.fullmatch(given) else secrets.token_hex(16)
        # for as long as this task: the server itself logs after us what we could not answer
        _asked.set(_Asked(request_id, scope))

        async def send_identified(message: Message) -> None:
            if message["type"] in _ANSWERS:
                headers = [*message.get("headers", ()), (_HEADER, request_id.encode())]
                message = {**message, "headers": headers}
            await send(message)

        await self._app(scope, receive, send_identified)


class _AsText(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return _without_secrets(super().format(record))


class _AsJson(logging.Formatter):
    def __init__(self, always: dict[str, str], trace: Callable[[], str | None]) -> None:
        super().__init__()
        self._always, self._trace = always, trace

    def format(self, record: logging.LogRecord) -> str:
        line: dict[str, str] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": _without_secrets(record.getMessage()),
            **self._always,
        }
        if (asked := _asked.get()) is not None:
            line["request_id"] = asked.request_id
            if meeting_id := asked.scope.get("path_params", {}).get("meeting_id"):
                line["meeting"] = meeting_digest(meeting_id)
        # a worker logs about jobs that are not its own process's
        if "job_id" in vars(record):
            line["job_id"] = vars(record)["job_id"]
        if traceparent := self._trace():
            line["trace_id"] = traceparent.split("-")[1]
        if record.exc_info:
            line["exception"] = _without_secrets(self.formatException(record.exc_info))
        return json.dumps(line, ensure_ascii=False)


def _without_secrets(text: str) -> str:
    return _SECRETS.sub("...", text)
