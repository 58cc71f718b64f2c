"""Who may read the figures of this process: the operator's Prometheus, not the world."""

from __future__ import annotations

import hmac

from fastapi import Depends, Request

from services.api.dependencies import Provided
from services.errors import Forbidden, Unauthorized
from services.limits import is_private

_OF_PROXIES = ("forwarded", "via", "x-real-ip")
"""Headers that a proxy adds, beside those that begin with `x-forwarded-`."""


async def _require_scraper(request: Request, services: Provided) -> None:
    """Let through who brings METANERF_METRICS_TOKEN; where none is set, who calls from nearby.

    A request that came through a proxy is the world's, wherever the proxy stands. Raises
    Unauthorized, Forbidden.
    """
    token = services.settings.security.metrics_token
    if token is not None:
        authorization = request.headers.get("authorization", "")
        expected = f"Bearer {token.get_secret_value()}"
        if not hmac.compare_digest(authorization.encode(), expected.encode()):
            raise Unauthorized(
                "the figures must be asked for with the token of METANERF_METRICS_TOKEN; "
                f"got {'another' if authorization else 'none'}"
            )
        return
    by_proxy = any(
        name in _OF_PROXIES or name.startswith("x-forwarded-") for name in request.headers
    )
    address = request.client.host if request.client else ""
    if by_proxy or not is_private(address):
        raise Forbidden(
            "the figures must be asked for straight from this machine or a private network; got "
            f"{'a request by a proxy' if by_proxy else address!r}; or set METANERF_METRICS_TOKEN"
        )


FiguresReader = Depends(_require_scraper)
"""Of a route that only the operator may read."""
