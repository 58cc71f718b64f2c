"""Login by the server's OpenID provider: there, back, and a token for the page.

A browser that comes back is sent to the page with `#login=` and a word in the address: `done`, or
why not. The page then asks for its token by `POST /v1/login/token`, with a cookie that the browser
got on its way back, so that no token is ever in an address, and nobody is logged in as somebody
else by following a link.
"""

from __future__ import annotations

import hmac
import logging
from datetime import timedelta
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse

from services.api import shapes
from services.api.dependencies import Provided, network_of_caller
from services.audit import note
from services.auth import ALL_SCOPES
from services.container import Services
from services.errors import (
    LoginDenied,
    LoginNotOffered,
    LoginStale,
    ProviderAway,
    ProviderFault,
    ServiceError,
)
from services.identity_provider import Attempt, IdentityProvider
from services.problems import PROBLEMS, problem_response, problems

log = logging.getLogger(__name__)

router = APIRouter(prefix="/v1", tags=["access"])

ATTEMPT_COOKIE, IDENTITY_COOKIE = "metanerf_login", "metanerf_identity"
_PATH = "/v1/login"
"""Where browsers send both."""
_ATTEMPT_LIFE = timedelta(minutes=10)
_IDENTITY_LIFE = timedelta(minutes=1)
_PAGE = r"^/(\?[!\"$-\[\]-~]*)?$"
"""The page and its query: nothing that could lead to another host."""
_WORDS: tuple[tuple[type[ServiceError], str], ...] = (
    (LoginDenied, "denied"),
    (LoginStale, "stale"),
    (ProviderAway, "away"),
    (ProviderFault, "fault"),
)
"""What the page is told of what went wrong."""
_REDIRECT = {302: {"description": "To the provider, or back to the page"}}


async def _provider(services: Provided) -> IdentityProvider:
    if services.identity_provider is None:
        raise LoginNotOffered(
            "the server's settings must name a provider (METANERF_OIDC_ISSUER) to log in; got "
            "none; come as a guest or by an invitation",
        )
    return services.identity_provider


Provider = Annotated[IdentityProvider, Depends(_provider)]
PagePath = Annotated[
    str, Query(pattern=_PAGE, max_length=1000, description="Where on the page to come back to.")
]


@router.get(
    "/login",
    status_code=302,
    response_class=RedirectResponse,
    responses=_REDIRECT | problems(403, 422, 429, 502, 503),
    summary="Log in at the server's provider",
)
async def log_in(
    request: Request, services: Provided, provider: Provider, to: PagePath = "/"
) -> Response:
    """To the provider, which sends the browser back to `/v1/login/callback`."""
    await run_in_threadpool(services.login_limit.take, network_of_caller(request))
    attempt = Attempt.new()
    try:
        url = await provider.authorization_url(attempt, _address(request, services, "/callback"))
    except ServiceError as error:
        return _refusal(request, error, to)
    response = RedirectResponse(url, 302)
    notes = {"state": attempt.state, "nonce": attempt.nonce, "verifier": attempt.verifier}
    ticket = services.tickets.write(ATTEMPT_COOKIE, _ATTEMPT_LIFE, to=to, **notes)
    _keep(response, request, services, ATTEMPT_COOKIE, ticket, _ATTEMPT_LIFE)
    return response


@router.get(
    "/login/callback",
    status_code=302,
    response_class=RedirectResponse,
    responses=_REDIRECT | problems(400, 403, 422, 429, 502, 503),
    summary="Come back from the provider",
)
async def come_back(
    request: Request,
    services: Provided,
    provider: Provider,
    state: Annotated[str, Query(max_length=200)] = "",
    code: Annotated[str, Query(max_length=4000)] = "",
    error: Annotated[str, Query(max_length=200, description="Why it was not done.")] = "",
) -> Response:
    """Whom the provider knows gets a cookie for `/v1/login/token`, and the page they came from."""
    await run_in_threadpool(services.login_limit.take, network_of_caller(request))
    to = "/"
    try:
        notes = services.tickets.read(ATTEMPT_COOKIE, request.cookies.get(ATTEMPT_COOKIE, ""))
        to = notes.pop("to")
        attempt = Attempt(**notes)
        if not hmac.compare_digest(state.encode(), attempt.state.encode()):
            raise LoginStale("the state must be of this browser's login; got another; log in again")
        if error or not code:
            raise LoginDenied(
                f"the provider must log you in; got {error or 'no code'!r}; try again, or ask "
                "whoever runs it",
            )
        who = await provider.identity(code, attempt, _address(request, services, "/callback"))
    except ServiceError as failure:
        response = _refusal(request, failure, to)
    else:
        response = RedirectResponse(f"{to}#login=done", 302)
        ticket = services.tickets.write(
            IDENTITY_COOKIE, _IDENTITY_LIFE, account=who.account, name=who.name
        )
        _keep(response, request, services, IDENTITY_COOKIE, ticket, _IDENTITY_LIFE)
    # each login is for once
    response.delete_cookie(ATTEMPT_COOKIE, path=_PATH)
    return response


@router.post(
    "/login/token",
    responses=problems(400, 403, 422, 503),
    summary="Get a token after logging in",
)
async def take_token(
    request: Request, response: Response, services: Provided, _provider: Provider
) -> shapes.LoggedIn:
    """Whoever has just come back from the provider gets a token of this server's, for an account
    that is the same at each login."""
    who = services.tickets.read(IDENTITY_COOKIE, request.cookies.get(IDENTITY_COOKIE, ""))
    lifetime = timedelta(hours=services.settings.security.token_lifetime_h)
    token, expires = services.tokens.issue(who["account"], ALL_SCOPES, lifetime)
    await run_in_threadpool(_note_login, services, who["account"])
    response.delete_cookie(IDENTITY_COOKIE, path=_PATH)
    response.headers["Cache-Control"] = "no-store"
    return shapes.LoggedIn(token=token, expires_at=expires, name=who["name"])


def _note_login(services: Services, account: str) -> None:
    with services.unit_of_work() as unit:
        note(services, unit, account, "account.logged_in")
        unit.commit()


@router.get(
    "/logout",
    status_code=302,
    response_class=RedirectResponse,
    responses={**_REDIRECT, 503: PROBLEMS[503]},
    summary="Log out of the server's provider",
)
async def log_out(request: Request, services: Provided) -> Response:
    """By the provider's own page, where it has one, and back to ours, which forgets its token."""
    to = None
    if services.identity_provider is not None:
        after = _public(request, services) + "/"
        try:
            to = await services.identity_provider.end_session_url(after)
        except ServiceError as error:
            log.warning("nobody is logged out of the provider: %s", error)
    return RedirectResponse(to or "/", 302)


def _refusal(request: Request, error: ServiceError, to: str) -> Response:
    """A problem; a browser that is on its way to the page gets it there, in the page's words."""
    word = next((word for kind, word in _WORDS if isinstance(error, kind)), None)
    if isinstance(error, ProviderAway | ProviderFault):
        log.warning("login failed: %s", error)
    if word is None or "text/html" not in request.headers.get("accept", ""):
        return problem_response(error)
    return RedirectResponse(f"{to}#login={word}", 302)


def _public(request: Request, services: Services) -> str:
    return (services.settings.server.public_url or str(request.base_url)).rstrip("/")


def _address(request: Request, services: Services, place: str) -> str:
    return _public(request, services) + _PATH + place


def _keep(
    response: Response,
    request: Request,
    services: Services,
    name: str,
    ticket: str,
    lifetime: timedelta,
) -> None:
    response.set_cookie(
        name,
        ticket,
        max_age=int(lifetime.total_seconds()),
        path=_PATH,
        secure=_public(request, services).startswith("https:"),
        httponly=True,
        samesite="lax",  # it must come along when the provider sends the browser back
    )
