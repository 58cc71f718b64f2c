"""A small OpenID provider over HTTP with real keys, which misbehaves as a test wants it to."""

from __future__ import annotations

import base64
import hashlib
import html
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated, Any
from urllib.parse import parse_qs, urlencode, urlsplit

import httpx
import jwt
import uvicorn
from cryptography.hazmat.primitives.asymmetric import rsa
from fastapi import FastAPI, Form, Header, Request
from fastapi.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from jwt.algorithms import RSAAlgorithm

CLIENT_ID, CLIENT_SECRET = "meetings", "of the provider: 100 % & more"
SUBJECTS = {"1001": "Ada", "1002": "Bo <b>&"}
"""Whom it knows: subject and name."""

Claims = dict[str, Any]


def new_key() -> rsa.RSAPrivateKey:
    """A pair of keys of RS256."""
    return rsa.generate_private_key(65537, 2048)


@dataclass(frozen=True)
class Grant:
    """What a code was given for."""

    subject: str
    nonce: str
    challenge: str
    redirect_uri: str


@dataclass
class OpenIdProvider:
    """What it is, and how it misbehaves."""

    issuer: str = ""
    keys: dict[str, rsa.RSAPrivateKey] = field(default_factory=dict)
    """By id; the last signs, all are published."""
    signing: rsa.RSAPrivateKey | None = None
    """Signs in place of the last."""
    change: Callable[[Claims], Claims] = lambda claims: claims
    """What becomes of the claims of a token."""
    encode: Callable[[Claims], str] | None = None
    """Writes a token in place of the usual way."""
    metadata: dict[str, Any] = field(default_factory=dict)
    """In place of what its description says; None: it does not say it."""
    failing: dict[str, int] = field(default_factory=dict)
    """Statuses of paths that fail."""
    grants: dict[str, Grant] = field(default_factory=dict)
    asked: list[str] = field(default_factory=list)
    """Paths that were asked for."""
    methods: list[str] = field(default_factory=list)
    """How clients said who they are."""

    def rotate(self) -> None:
        """Another key, in place of all others."""
        self.keys = {f"key-{secrets.token_hex(4)}": new_key()}

    def description(self) -> dict[str, Any]:
        """Its answer to discovery."""
        places = {
            "authorization_endpoint": "authorize",
            "token_endpoint": "token",
            "jwks_uri": "keys",
            "end_session_endpoint": "logout",
        }
        said = {name: f"{self.issuer}/{path}" for name, path in places.items()}
        said = {"issuer": self.issuer, **said, **self.metadata}
        return {name: value for name, value in said.items() if value is not None}

    def token(self, grant: Grant) -> str:
        """An ID token."""
        now = int(time.time())
        claims = self.change(
            {
                "iss": self.issuer,
                "sub": grant.subject,
                "aud": CLIENT_ID,
                "iat": now,
                "exp": now + 300,
                "nonce": grant.nonce,
                "name": SUBJECTS[grant.subject],
                "email": "shared@example.org",
            }
        )
        if self.encode is not None:
            return self.encode(claims)
        name, key = list(self.keys.items())[-1]
        return jwt.encode(claims, self.signing or key, "RS256", headers={"kid": name})


def _client_of(provider: OpenIdProvider, authorization: str, form: dict[str, str]) -> bool:
    """Whether the client says who it is, in either way of RFC 6749, section 2.3.1."""
    if authorization:
        provider.methods.append("basic")
        pair = base64.b64decode(authorization.removeprefix("Basic ")).decode().partition(":")
        given = [parse_qs(f"x={pair[i]}").get("x", [""])[0] for i in (0, 2)]
    else:
        provider.methods.append("post")
        given = [form.get("client_id", ""), form.get("client_secret", "")]
    return given == [CLIENT_ID, CLIENT_SECRET]


def _application(provider: OpenIdProvider) -> FastAPI:
    app = FastAPI()

    @app.middleware("http")
    async def fail(request: Request, call_next: Callable[[Request], Any]) -> Response:
        provider.asked.append(request.url.path)
        if status := provider.failing.get(request.url.path):
            return JSONResponse({"error": "as the test wants"}, status)
        return await call_next(request)

    @app.get("/.well-known/openid-configuration")
    def describe() -> dict[str, Any]:
        return provider.description()

    @app.get("/keys")
    def keys() -> dict[str, Any]:
        public = {
            name: RSAAlgorithm.to_jwk(key.public_key(), as_dict=True)
            for name, key in provider.keys.items()
        }
        return {"keys": [{**key, "kid": name, "use": "sig"} for name, key in public.items()]}

    @app.get("/authorize")
    def authorize(request: Request) -> HTMLResponse:
        asked = dict(request.query_params)
        assert asked["response_type"] == "code"
        assert asked["code_challenge_method"] == "S256"
        assert "openid" in asked["scope"].split()
        assert asked["client_id"] == CLIENT_ID
        ways = {f"As {name}": {"subject": subject} for subject, name in SUBJECTS.items()}
        ways["Not at all"] = {"error": "access_denied"}
        links = ""
        for text, way in ways.items():
            href = html.escape(f"/decide?{urlencode({**asked, **way})}")
            links += f'<p><a href="{href}">{html.escape(text)}</a>'
        return HTMLResponse(f"<!doctype html><title>Who are you?</title>{links}")

    @app.get("/decide")
    def decide(request: Request) -> RedirectResponse:
        asked = dict(request.query_params)
        answer = {"state": asked["state"]}
        if "error" in asked:
            answer |= {"error": asked["error"], "error_description": "<b>no</b>"}
        else:
            answer["code"] = secrets.token_urlsafe(16)
            provider.grants[answer["code"]] = Grant(
                asked["subject"], asked["nonce"], asked["code_challenge"], asked["redirect_uri"]
            )
        return RedirectResponse(f"{asked['redirect_uri']}?{urlencode(answer)}", 302)

    @app.post("/token")
    def token(
        code: Annotated[str, Form()],
        redirect_uri: Annotated[str, Form()],
        code_verifier: Annotated[str, Form()],
        grant_type: Annotated[str, Form()],
        client_id: Annotated[str, Form()] = "",
        client_secret: Annotated[str, Form()] = "",
        authorization: Annotated[str, Header()] = "",
    ) -> JSONResponse:
        form = {"client_id": client_id, "client_secret": client_secret}
        if not _client_of(provider, authorization, form):
            return JSONResponse({"error": "invalid_client"}, 401)
        digest = hashlib.sha256(code_verifier.encode()).digest()
        challenge = base64.urlsafe_b64encode(digest).rstrip(b"=").decode()
        grant = provider.grants.pop(code, None)
        kept = (grant.challenge, grant.redirect_uri) if grant else None
        if grant is None or kept != (challenge, redirect_uri) or grant_type != "authorization_code":
            return JSONResponse({"error": "invalid_grant"}, 400)
        answer = {"access_token": "of no use here", "token_type": "Bearer"}
        return JSONResponse({**answer, "id_token": provider.token(grant)})

    @app.get("/logout")
    def log_out(client_id: str, post_logout_redirect_uri: str) -> RedirectResponse:
        assert client_id == CLIENT_ID
        return RedirectResponse(post_logout_redirect_uri, 302)

    return app


@contextmanager
def running_provider() -> Iterator[OpenIdProvider]:
    """One on a free port of this machine."""
    provider = OpenIdProvider()
    provider.rotate()
    config = uvicorn.Config(_application(provider), port=0, log_level="warning")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        assert thread.is_alive(), "the provider did not start"
        time.sleep(0.02)
    port = server.servers[0].sockets[0].getsockname()[1]
    provider.issuer = f"http://127.0.0.1:{port}"
    try:
        yield provider
    finally:
        server.should_exit = True
        thread.join(30.0)


def ways(location: str) -> dict[str, str]:
    """Addresses by the words on the provider's page at `location`."""
    page = httpx.get(location).raise_for_status().text
    host = "{0.scheme}://{0.netloc}".format(urlsplit(location))
    found = [part.partition('">') for part in page.split('<a href="')[1:]]
    return {
        html.unescape(text.partition("</a>")[0]): host + html.unescape(href)
        for href, _, text in found
    }
