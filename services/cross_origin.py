"""Which other origins' pages may call a gateway (CORS): those set, and those of other gateways.

A page comes from one gateway, or from the address that all share, and is sent to its meeting's
home, which may be another.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from starlette.middleware.cors import CORSMiddleware
from starlette.types import ASGIApp

_EXPOSED = (
    *("Location", "ETag", "Link", "Accept-Patch", "Retry-After", "Upload-Offset"),
    "X-Request-Id",
)


class AllowOrigins(CORSMiddleware):
    """CORS whose origins may change while the process runs."""

    def __init__(
        self, app: ASGIApp, always: Collection[str], known: Callable[[], Collection[str]]
    ) -> None:
        super().__init__(
            app,
            allow_origins=always,
            allow_methods=["*"],
            allow_headers=["*"],
            expose_headers=_EXPOSED,
        )
        self._known = known

    def is_allowed_origin(self, origin: str) -> bool:
        """Whether pages of `origin` may read what is answered."""
        return super().is_allowed_origin(origin) or origin in self._known()
