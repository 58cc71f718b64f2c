"""What browsers may do with an answer: Content Security Policy (CSP, level 3) and its neighbours.

Closed by default. An answer of the API may load and run nothing, should a browser ever show it as a
document. The page may run its own files alone, no script or style that stands in markup, and talk
to its own server and the other gateways (services.homes). A worker goes by the policy that its
script came with, and only workers find landmarks, with WebAssembly: so the page itself may not
compile any.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Collection
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

CSP = "Content-Security-Policy"
_CLOSED = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
_DEVICES = ("camera", "microphone", "display-capture", "xr-spatial-tracking", "autoplay")
_UNUSED = ("geolocation", "midi", "payment", "serial", "usb", "hid")
PERMISSIONS = ", ".join(
    [*(f"{name}=(self)" for name in _DEVICES), *(f"{name}=()" for name in _UNUSED)]
)
"""Permissions-Policy of whatever a browser shows: what the page uses, and no frame in it."""
SCRIPT_POLICY = f"{_CLOSED}; script-src 'self' 'wasm-unsafe-eval'; connect-src 'self'"
"""Of scripts, for those that are a worker's."""


def page_policy(gateways: Collection[str]) -> str:
    """Of the page; `gateways` are the origins beside its own that meetings may live at."""
    # 'self' holds for WebSockets, too; another origin's have to be named
    others = sorted({*gateways, *(_socket_origin(one) for one in gateways)})
    return "; ".join(
        [
            _CLOSED,
            "script-src 'self'",
            "worker-src 'self'",
            "style-src 'self'",
            "img-src 'self' blob: data:",
            "media-src 'self' blob:",
            " ".join(["connect-src", "'self'", *others]),
        ]
    )


def document_policy(style: str) -> str:
    """Of a document that is all in one answer: no script, and `style` alone in its markup."""
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    return f"{_CLOSED}; style-src 'sha256-{digest}'"


def _socket_origin(origin: str) -> str:
    parts = urlsplit(origin)
    return f"{'wss' if parts.scheme == 'https' else 'ws'}://{parts.netloc}"


class ClosedByDefault:
    """ASGI middleware: every answer has a policy, the strictest unless it brings its own."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_closed(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.setdefault(CSP, _CLOSED)
                headers["Permissions-Policy"] = PERMISSIONS
                headers["X-Content-Type-Options"] = "nosniff"
                # an invitation stands in the page's address
                headers["Referrer-Policy"] = "no-referrer"
            await send(message)

        await self._app(scope, receive, send_closed if scope["type"] == "http" else send)
