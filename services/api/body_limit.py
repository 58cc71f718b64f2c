"""How large the body of a request may be, unless its route lifts the limit."""

from __future__ import annotations

from fastapi import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.errors import TooLarge

LARGEST_BODY_BYTES = 1 << 20
"""Of a request that is read into memory: the largest, a pose and its camera, has a few thousand."""
_OWN_LIMIT = "metanerf.own_limit"


class LimitBodies:
    """ASGI middleware: no request fills the memory. Raises TooLarge where the body is read."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        received = 0

        async def limited() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > LARGEST_BODY_BYTES and not scope.get(_OWN_LIMIT):
                raise TooLarge(
                    f"the body must have at most {LARGEST_BODY_BYTES} bytes; got more; clips and "
                    "keypoints go to the sequences of a person",
                )
            return message

        await self._app(scope, limited if scope["type"] == "http" else receive, send)


def lift_body_limit(request: Request) -> None:
    """Have the body of `request` not limited here: call it where its reader holds its own limit."""
    request.scope[_OWN_LIMIT] = True
