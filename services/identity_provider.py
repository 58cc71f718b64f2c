"""Login by an OpenID provider: authorization code flow (OpenID Connect Core 1.0), PKCE (RFC 7636).

The provider's addresses are found by discovery (OpenID Connect Discovery 1.0) and kept for a while;
its keys are read at each login, so that they may change at any time.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import secrets
import time
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote_plus, urlencode, urlsplit

import jwt

from services.errors import ProviderAway, ProviderFault
from services.login_settings import LoginSettings

SCOPE = "openid profile"
_TIMEOUT_S = 5.0
"""For each step of a call: to connect, to send, to hear something."""
_KEPT_S = 600.0
"""How long the provider's description is good for."""
_RETRY_AFTER_S = 10
_LEEWAY_S = 30.0
"""How far its clock and ours may be apart."""
_ALGORITHMS = frozenset(
    {"RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA"}
)
"""Signatures by a key pair alone: what a shared secret signs, anybody who knows it could sign."""
_LONGEST_NAME = 60
_NAMES = ("name", "preferred_username", "nickname")

Document = dict[str, Any]


@dataclass(frozen=True)
class Attempt:
    """What one login must bring back."""

    state: str
    nonce: str
    verifier: str

    @staticmethod
    def new() -> Attempt:
        """One that nobody can guess."""
        return Attempt(*(secrets.token_urlsafe(32) for _ in range(3)))


@dataclass(frozen=True)
class Identity:
    """Somebody whom the provider knows."""

    account: str
    """Theirs here: the same at each login, and nobody else's."""
    name: str
    """As the provider calls them; empty where it does not say."""


def account_of(issuer: str, subject: str) -> str:
    """The account of a provider's subject. Neither e-mail nor name, which pass to other people."""
    return "oidc-" + hashlib.sha256(f"{issuer}\0{subject}".encode()).hexdigest()[:40]


class IdentityProvider:
    """The provider of this server's settings."""

    def __init__(self, settings: LoginSettings) -> None:
        assert settings.issuer
        assert settings.client_id
        assert settings.client_secret
        self._issuer, self._client_id = settings.issuer, settings.client_id
        self._secret = settings.client_secret.get_secret_value()
        self._found: tuple[float, Document] | None = None
        import httpx  # here, so that a server without a provider starts without it

        self._certificates = httpx.create_ssl_context()

    async def authorization_url(self, attempt: Attempt, redirect_uri: str) -> str:
        """Where the browser goes to log in. Raises ProviderAway, ProviderFault."""
        digest = hashlib.sha256(attempt.verifier.encode()).digest()
        asked = {
            "response_type": "code",
            "client_id": self._client_id,
            "redirect_uri": redirect_uri,
            "scope": SCOPE,
            "state": attempt.state,
            "nonce": attempt.nonce,
            "code_challenge": base64.urlsafe_b64encode(digest).rstrip(b"=").decode(),
            "code_challenge_method": "S256",
        }
        return _with_query(_address(await self._metadata(), "authorization_endpoint"), asked)

    async def identity(self, code: str, attempt: Attempt, redirect_uri: str) -> Identity:
        """Whose code it is. Raises ProviderAway, and ProviderFault for whatever is not as it must
        be, a token that is not for us among it."""
        metadata = await self._metadata()
        form = {
            "grant_type": "authorization_code",
            "code": code,
            "redirect_uri": redirect_uri,
            "code_verifier": attempt.verifier,
        }
        methods = metadata.get("token_endpoint_auth_methods_supported", ["client_secret_basic"])
        headers = {}
        if "client_secret_basic" in methods:
            # RFC 6749, section 2.3.1: both as in a form
            pair = f"{quote_plus(self._client_id)}:{quote_plus(self._secret)}"
            headers["Authorization"] = f"Basic {base64.b64encode(pair.encode()).decode()}"
        else:
            form |= {"client_id": self._client_id, "client_secret": self._secret}
        answer = await self._ask(
            "POST", _address(metadata, "token_endpoint"), data=form, headers=headers
        )
        token = answer.get("id_token")
        if not isinstance(token, str):
            raise ProviderFault("the provider must give an ID token for a code; got none")
        keys = await self._ask("GET", _address(metadata, "jwks_uri"))
        claims = self._verified(token, keys)
        if not hmac.compare_digest(str(claims.get("nonce", "")).encode(), attempt.nonce.encode()):
            raise ProviderFault("the ID token must have the nonce of this login; got another")
        return Identity(account_of(self._issuer, claims["sub"]), _name_of(claims))

    async def end_session_url(self, after: str) -> str | None:
        """Where the browser logs out of the provider, to come back to `after` (OpenID Connect
        RP-Initiated Logout 1.0); None where that cannot be. Raises ProviderAway, ProviderFault."""
        metadata = await self._metadata()
        if "end_session_endpoint" not in metadata:
            return None
        asked = {"client_id": self._client_id, "post_logout_redirect_uri": after}
        return _with_query(_address(metadata, "end_session_endpoint"), asked)

    def _verified(self, token: str, keys: Document) -> Document:
        """Its claims, if it is one of this provider's, for us, and not over."""
        try:
            claims = jwt.decode(
                token,
                _key_of(token, keys),
                sorted(_ALGORITHMS),
                audience=self._client_id,
                issuer=self._issuer,
                leeway=_LEEWAY_S,
                options={"require": ["iss", "sub", "aud", "exp", "iat"]},
            )
        except (jwt.PyJWTError, ValueError, TypeError) as error:
            raise ProviderFault(
                f"the ID token must be the provider's, for this server, and good now; got: {error}"
            ) from error
        # Core, section 3.1.3.7: a token for several must say that it was given to us
        several = isinstance(claims["aud"], list) and len(claims["aud"]) > 1
        if claims.get("azp", None if several else self._client_id) != self._client_id:
            raise ProviderFault("the ID token must be given to this server; got another's")
        if not claims["sub"]:
            raise ProviderFault("the ID token must say whose it is; got an empty subject")
        return claims

    async def _metadata(self) -> Document:
        now_s = time.monotonic()
        if self._found and now_s - self._found[0] < _KEPT_S:
            return self._found[1]
        url = self._issuer.rstrip("/") + "/.well-known/openid-configuration"
        found = await self._ask("GET", url)
        if found.get("issuer") != self._issuer:
            raise ProviderFault(
                f"METANERF_OIDC_ISSUER must be the provider's own word for itself, "
                f"{found.get('issuer')!r}; got {self._issuer!r}"
            )
        self._found = now_s, found
        return found

    async def _ask(self, method: str, url: str, **request: Any) -> Document:
        """What the provider answers, as JSON."""
        import httpx

        try:
            async with httpx.AsyncClient(timeout=_TIMEOUT_S, verify=self._certificates) as client:
                answer = await client.request(method, url, **request)
        except httpx.HTTPError as error:
            raise ProviderAway(
                f"the provider must be reached to log in; got no answer of {_host(url)} "
                f"({type(error).__name__}); try again in a moment",
                _RETRY_AFTER_S,
            ) from error
        if answer.status_code >= 500:
            raise ProviderAway(
                f"the provider must answer to log in; got {answer.status_code} of {_host(url)}; "
                "try again in a moment",
                _RETRY_AFTER_S,
            )
        try:
            document = answer.json()
        except ValueError:
            document = None
        if not answer.is_success or not isinstance(document, dict):
            error = document.get("error") if isinstance(document, dict) else "no JSON object"
            raise ProviderFault(
                f"the provider must answer {urlsplit(url).path} as OpenID Connect says; got "
                f"{answer.status_code}, {error!r}"
            )
        return document


def _key_of(token: str, keys: Document) -> jwt.PyJWK:
    """The key that signed `token`, by its own word. Raises PyJWTError where there is none."""
    header = jwt.get_unverified_header(token)
    algorithm = header.get("alg")
    if algorithm not in _ALGORITHMS:
        raise jwt.InvalidAlgorithmError(f"a signature by {algorithm!r}")
    listed = [one for one in keys.get("keys", ()) if isinstance(one, dict)]
    fitting = [
        one
        for one in listed
        if one.get("use", "sig") == "sig"
        and one.get("alg", algorithm) == algorithm
        and one.get("kid") == header.get("kid", one.get("kid"))
    ]
    if len(fitting) != 1:
        raise jwt.InvalidKeyError(f"a key that {len(fitting)} of the provider's {len(listed)} are")
    return jwt.PyJWK.from_dict(fitting[0], algorithm)


def _name_of(claims: Document) -> str:
    """On one line, and no longer than a name on the page."""
    told = (claims.get(one) for one in _NAMES)
    name = next((one for one in told if isinstance(one, str) and one.strip()), "")
    return " ".join("".join(c if c.isprintable() else " " for c in name).split())[:_LONGEST_NAME]


def _address(metadata: Document, name: str) -> str:
    url = metadata.get(name)
    if not isinstance(url, str) or urlsplit(url).scheme not in ("https", "http"):
        raise ProviderFault(f"the provider's description must have {name!r}; got {url!r}")
    return url


def _with_query(url: str, fields: dict[str, str]) -> str:
    """`url`, which may have a query of its own, and `fields`."""
    return f"{url}{'&' if urlsplit(url).query else '?'}{urlencode(fields)}"


def _host(url: str) -> str:
    return urlsplit(url).netloc
