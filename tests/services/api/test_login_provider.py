"""What a provider may do wrong in a login, or is free to do."""

from __future__ import annotations

import re
import socket
from dataclasses import replace

import jwt
import pytest

from services.composition import build_services
from tests.services.api.logins import HTML, browser, come_back, leave_for, log_in
from tests.services.api.logins import ada as ada
from tests.services.api.logins import clock as clock
from tests.services.api.logins import provider as provider
from tests.services.api.logins import running as running
from tests.services.api.logins import services as services
from tests.services.api.logins import settings_with_login as settings_with_login
from tests.services.openid_provider import (
    CLIENT_ID,
    CLIENT_SECRET,
    Claims,
    new_key,
)


def _with(**values: object):
    def change(claims: Claims) -> Claims:
        return {k: v for k, v in {**claims, **values}.items() if v is not None}

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_with(nonce="another"), "must have the nonce"),
        (_with(nonce=None), "must have the nonce"),
        (_with(aud="somebody else"), "[Aa]udience"),
        (_with(aud=None), "aud"),
        (_with(aud=[CLIENT_ID, "somebody else"]), "given to this server"),
        (_with(aud=[CLIENT_ID, "x"], azp="x"), "given to this server"),
        (_with(azp="somebody else"), "given to this server"),
        (_with(iss="https://other.example.org"), "[Ii]ssuer"),
        (_with(exp=1_700_000_000), "expired"),
        (_with(exp=None), "exp"),
        (_with(sub=None), "sub"),
        (_with(sub=""), "whose it is"),
        (_with(sub=7), "[Ss]ub"),
    ],
)
async def test_an_id_token_that_is_not_for_this_login_is_refused(ada, provider, change, words):
    provider.change = change
    refused = await come_back(ada, await leave_for(ada))
    assert (refused.status_code, refused.json()["type"]) == (502, "urn:metanerf:provider-fault")
    assert re.search(words, refused.json()["detail"])
    assert (await ada.post("/v1/login/token")).status_code == 400


async def test_a_token_for_several_that_was_given_to_us_is_taken(ada, provider):
    provider.change = _with(aud=["x", CLIENT_ID], azp=CLIENT_ID)
    assert (await log_in(ada))["name"] == "Ada"


def _none(claims: Claims) -> str:
    return jwt.encode(claims, "", "none")


def _by_the_shared_secret(claims: Claims) -> str:
    return jwt.encode(claims, CLIENT_SECRET.ljust(32), "HS256", headers={"kid": "key"})


@pytest.mark.parametrize(
    "encode", [_none, _by_the_shared_secret, lambda _: "no.token", lambda _: ""]
)
async def test_a_token_without_a_signature_by_the_providers_key_is_refused(ada, provider, encode):
    provider.encode = encode
    assert (await come_back(ada, await leave_for(ada))).status_code == 502


async def test_a_signature_by_another_key_of_the_same_name_is_refused(ada, provider):
    provider.signing = new_key()
    refused = await come_back(ada, await leave_for(ada))
    assert refused.status_code == 502
    assert "ignature" in refused.json()["detail"]


async def test_the_provider_may_change_its_keys_at_any_time(ada, provider):
    await log_in(ada)
    old = dict(provider.keys)
    provider.rotate()
    await log_in(ada)
    # the old one beside the new one, as providers do for a while
    provider.keys = {**old, **provider.keys}
    await log_in(ada)
    provider.keys = dict(reversed(provider.keys.items()))
    await log_in(ada)


async def test_the_client_says_who_it_is_as_the_provider_wants_it(services, ada, provider):
    await log_in(ada)
    provider.metadata = {"token_endpoint_auth_methods_supported": ["client_secret_post"]}
    async with browser(build_services(services.settings)) as other:
        await log_in(other)
    assert provider.methods == ["basic", "post"]


@pytest.mark.parametrize(
    ("path", "status", "name"),
    [
        ("/token", 503, "provider-away"),
        ("/keys", 500, "provider-away"),
        ("/token", 400, "provider-fault"),
    ],
)
async def test_a_provider_that_fails_on_the_way_back_is_named(ada, provider, path, status, name):
    address = await leave_for(ada)
    provider.failing = {path: status}
    refused = await come_back(ada, address)
    assert refused.json()["type"] == f"urn:metanerf:{name}"
    assert refused.status_code == {"provider-away": 503, "provider-fault": 502}[name]
    provider.failing = {}
    await log_in(ada)


async def test_a_provider_that_is_away_is_a_problem_and_words_on_the_page(settings_with_login):
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))  # nobody listens
        issuer = f"http://127.0.0.1:{silent.getsockname()[1]}"
        login = settings_with_login.login.model_copy(update={"issuer": issuer})
        services = build_services(replace(settings_with_login, login=login))
        async with browser(services) as client:
            away = await client.get("/v1/login")
            assert (away.status_code, away.json()["type"]) == (503, "urn:metanerf:provider-away")
            assert int(away.headers["retry-after"]) > 0
            shown = await client.get("/v1/login?to=/?meeting=m", headers=HTML)
            assert shown.headers["location"] == "/?meeting=m#login=away"
            out = await client.get("/v1/logout")
            assert (out.status_code, out.headers["location"]) == (302, "/")
        services.close()


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        ({"issuer": "https://other.example.org"}, "METANERF_OIDC_ISSUER must be"),
        ({"authorization_endpoint": None}, "authorization_endpoint"),
        ({"authorization_endpoint": "javascript:alert(1)"}, "authorization_endpoint"),
    ],
)
async def test_a_description_that_is_none_is_refused(ada, provider, metadata, words):
    provider.metadata = metadata
    refused = await ada.get("/v1/login")
    assert refused.status_code == 502
    assert words in refused.json()["detail"]
