"""What a route asks for by the type of a parameter: the gateway, its services, and who calls."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Security
from fastapi.requests import HTTPConnection
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer, SecurityScopes

from services.auth import Principal
from services.container import Services
from services.errors import ScopeMissing, Unauthorized
from services.gateway import Gateway, gateway_of
from services.limits import network_of


async def _gateway(connection: HTTPConnection) -> Gateway:
    return gateway_of(connection.app)


CurrentGateway = Annotated[Gateway, Depends(_gateway)]
"""The gateway that answers; of a request and of a WebSocket."""


async def _services(gateway: CurrentGateway) -> Services:
    return gateway.services


Provided = Annotated[Services, Depends(_services)]
"""The services of the gateway that answers."""

_bearer = HTTPBearer(auto_error=False, description="A token of this server (JWT).")


def network_of_caller(connection: HTTPConnection) -> str:
    """What tells one caller's address from another's."""
    return network_of(connection.client.host if connection.client else "")


def principal(
    connection: HTTPConnection,
    services: Provided,
    needed: SecurityScopes,
    credentials: Annotated[HTTPAuthorizationCredentials | None, Security(_bearer)],
) -> Principal:
    """The caller, who must hold every scope that the route asks for.

    Raises Unauthorized, ScopeMissing, TooManyRequests.
    """
    # before the token is read: whoever guesses tokens has none that is good
    services.address_limit.take(network_of_caller(connection))
    if credentials is None:
        raise Unauthorized(
            "the request must carry `Authorization: Bearer TOKEN`; got none; get a token first"
        )
    caller = services.tokens.read(credentials.credentials)
    connection.state.account = caller.account
    services.account_limit.take(caller.counted_as)
    missing = sorted(set(needed.scopes) - caller.scopes)
    if missing:
        raise ScopeMissing(
            f"the token must have scope {missing[0]!r}; got {sorted(caller.scopes)}; "
            "get a token with more scopes",
            missing[0],
        )
    return caller


Reader = Annotated[Principal, Security(principal, scopes=["read"])]
"""A caller who may look."""
Writer = Annotated[Principal, Security(principal, scopes=["write"])]
"""A caller who may change."""
Joiner = Annotated[Principal, Security(principal, scopes=["join"])]
"""A caller who may enter meetings."""
