"""How one is let in, and tokens for guests, where access is open."""

from __future__ import annotations

from datetime import timedelta
from typing import Annotated

from fastapi import APIRouter, Header, Request, status

from services.api import shapes
from services.api.dependencies import Provided, network_of_caller
from services.auth import ALL_SCOPES, new_guest
from services.errors import AccessNotOpen
from services.problems import problems

router = APIRouter(prefix="/v1", tags=["access"], responses=problems(403, 422, 429))


@router.get("/access", summary="See how one is let in")
async def how_one_is_let_in(services: Provided) -> shapes.Access:
    """Whether anybody may come as a guest, and whether one may log in."""
    return shapes.Access(
        guests=services.settings.security.open_access,
        login=services.identity_provider is not None,
    )


@router.post("/guest", status_code=status.HTTP_201_CREATED, summary="Get a guest's token")
def be_guest(
    request: Request, services: Provided, authorization: Annotated[str, Header()] = ""
) -> shapes.Guest:
    """A guest's token for anybody, limited in rate; only where access is open, as in the demo.

    Each guest is somebody of their own. Who brings their last token, even one that has ended, stays
    who they were.
    """
    if not services.settings.security.open_access:
        raise AccessNotOpen(
            "guests must be let in by the server's settings (open_access); got a server that "
            "lets none in; ask its keeper for a token",
        )
    services.guest_limit.take(network_of_caller(request))
    lifetime = timedelta(hours=services.settings.security.token_lifetime_h)
    guest = services.tokens.guest_of(authorization.removeprefix("Bearer ")) or new_guest()
    token, expires = services.tokens.issue(guest, ALL_SCOPES, lifetime)
    return shapes.Guest(token=token, expires_at=expires)
