"""Login by a real OpenID provider over HTTP: whole, and what browsers may do wrong in it."""

from __future__ import annotations

import asyncio
import re
from dataclasses import replace
from datetime import timedelta

import httpx
import hypothesis
import jwt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.auth import ALL_SCOPES, is_guest
from services.composition import build_services
from services.identity_provider import account_of
from tests.services.api.logins import BASE, HTML, browser, come_back, leave_for, log_in
from tests.services.api.logins import ada as ada
from tests.services.api.logins import clock as clock
from tests.services.api.logins import provider as provider
from tests.services.api.logins import running as running
from tests.services.api.logins import services as services
from tests.services.api.logins import settings_with_login as settings_with_login
from tests.services.openid_provider import (
    CLIENT_ID,
    CLIENT_SECRET,
    ways,
)


async def test_who_logs_in_has_the_same_account_each_time_with_all_scopes(services, ada, provider):
    assert (await ada.get("/v1/access")).json() == {"guests": True, "login": True}
    given = await log_in(ada)
    assert given["name"] == "Ada"
    who = services.tokens.read(given["token"])
    assert who.scopes == ALL_SCOPES
    assert who.account == account_of(provider.issuer, "1001")
    assert not is_guest(who.account)
    lifetime = timedelta(hours=services.settings.security.token_lifetime_h)
    claims = jwt.decode(given["token"], options={"verify_signature": False})
    assert claims["exp"] - claims["iat"] == lifetime.total_seconds()
    # an e-mail may pass to somebody else, and be changed
    provider.change = lambda claims: {**claims, "email": "new@example.org", "name": "Ada B."}
    async with browser(services) as elsewhere:
        again = await log_in(elsewhere)
    assert services.tokens.read(again["token"]).account == who.account
    assert again["name"] == "Ada B."


def test_an_account_is_of_issuer_and_subject():
    pairs = [("https://a.example", "1"), ("https://a.example", "2"), ("https://b.example", "1")]
    accounts = {account_of(*pair) for pair in pairs}
    assert len(accounts) == len(pairs)
    assert all(re.fullmatch(r"oidc-[0-9a-f]{40}", one) for one in accounts)


async def test_two_people_see_only_their_own(services, ada):
    async with browser(services) as bo:
        assert (await log_in(ada))["name"] == "Ada"
        assert (await log_in(bo, "As Bo <b>&"))["name"] == "Bo <b>&"
        mine = (await ada.post("/v1/people", json={"name": "Ada"})).json()["id"]
        meeting = (await ada.post("/v1/meetings", json={"name": "Monday"})).json()["id"]
        assert [one["id"] for one in (await ada.get("/v1/people")).json()["items"]] == [mine]
        assert (await bo.get("/v1/people")).json()["items"] == []
        for method in ("GET", "DELETE"):
            assert (await bo.request(method, f"/v1/people/{mine}")).status_code == 403
        environment = f"/v1/meetings/{meeting}/environment"
        changed = await bo.put(environment, json={"name": "park"})
        assert changed.status_code == 403
        # a meeting's id is its invitation
        assert (await bo.get(f"/v1/meetings/{meeting}")).status_code == 200


async def test_what_goes_to_the_provider_is_new_each_time_and_says_no_secret(ada, provider):
    asked = []
    for _ in range(2):
        away = await ada.get("/v1/login")
        url = httpx.URL(away.headers["location"])
        assert f"{url.copy_with(query=None)}" == f"{provider.issuer}/authorize"
        asked.append(dict(url.params))
    assert asked[0]["redirect_uri"] == f"{BASE}/v1/login/callback"
    assert asked[0]["scope"] == "openid profile"
    for name in ("state", "nonce", "code_challenge"):
        assert len({one[name] for one in asked} | {asked[0]["client_id"]}) == 3
        assert all(len(one[name]) >= 43 for one in asked)
    assert CLIENT_SECRET not in str(asked)


@pytest.mark.parametrize(("public_url", "secure"), [("", False), ("https://meet.test", True)])
async def test_the_cookie_is_for_the_way_back_alone(services, provider, public_url, secure):
    server = services.settings.server.model_copy(update={"public_url": public_url})
    services = replace(services, settings=replace(services.settings, server=server))
    async with browser(services, public_url or BASE) as client:
        away = await client.get("/v1/login")
        cookie = away.headers["set-cookie"]
        assert {"HttpOnly", "Path=/v1/login", "Max-Age=600", "SameSite=lax"} <= set(
            cookie.split("; ")
        )
        assert ("Secure" in cookie) is secure
        back = await come_back(
            client, httpx.get(ways(away.headers["location"])["As Ada"]).headers["location"]
        )
        set_ = back.headers.get_list("set-cookie")
        assert any("metanerf_login=" in one and "Max-Age=0" in one for one in set_)
        (kept,) = (one for one in set_ if "metanerf_identity=" in one)
        assert "HttpOnly" in kept
        assert ("Secure" in kept) is secure
        # nothing in the address tells who it is
        assert back.headers["location"] == "/#login=done"


async def test_whoever_comes_back_too_late_or_in_another_browser_begins_anew(services, ada, clock):
    back = await leave_for(ada)
    async with browser(services) as other:
        refused = await come_back(other, back)
    assert (refused.status_code, refused.json()["type"]) == (400, "urn:metanerf:login-stale")
    assert "cookie of a login that this browser began" in refused.json()["detail"]
    clock.now += timedelta(minutes=10)
    late = await come_back(ada, back)
    assert (late.status_code, late.json()["type"]) == (400, "urn:metanerf:login-stale")
    assert (await ada.post("/v1/login/token")).status_code == 400


async def test_a_wrong_state_is_refused_and_the_attempt_is_over(ada, provider):
    back = httpx.URL(await leave_for(ada))
    wrong = await come_back(ada, str(back.copy_merge_params({"state": "x" * 43})))
    assert (wrong.status_code, wrong.json()["type"]) == (400, "urn:metanerf:login-stale")
    assert "/token" not in provider.asked
    assert (await come_back(ada, str(back))).status_code == 400


async def test_a_login_is_for_once(ada):
    back = await leave_for(ada)
    assert (await come_back(ada, back)).status_code == 302
    assert (await come_back(ada, back)).status_code == 400
    assert (await ada.post("/v1/login/token")).status_code == 200
    assert (await ada.post("/v1/login/token")).status_code == 400


async def test_a_token_is_for_its_minute(ada, clock):
    assert (await come_back(ada, await leave_for(ada))).status_code == 302
    clock.now += timedelta(minutes=1)
    assert (await ada.post("/v1/login/token")).status_code == 400


async def test_neither_ticket_nor_token_passes_for_the_other(services, ada):
    await leave_for(ada)
    ticket = ada.cookies["metanerf_login"]
    for taken in (ticket, services.tokens.issue("house", ALL_SCOPES, timedelta(hours=1))[0]):
        async with browser(services) as other:
            other.cookies.set("metanerf_identity", taken)
            assert (await other.post("/v1/login/token")).status_code == 400
    header = {"Authorization": f"Bearer {ticket}"}
    assert (await ada.get("/v1/people", headers=header)).status_code == 401


async def test_who_declines_at_the_provider_is_told_so_on_the_page(ada):
    address = await leave_for(ada, "Not at all", "/?meeting=m")
    denied = await come_back(ada, address)
    assert (denied.status_code, denied.json()["type"]) == (403, "urn:metanerf:login-denied")
    assert "access_denied" in denied.json()["detail"]
    address = await leave_for(ada, "Not at all", "/?meeting=m")
    shown = await come_back(ada, address, **HTML)
    assert (shown.status_code, shown.headers["location"]) == (302, "/?meeting=m#login=denied")
    stale = await come_back(ada, address, **HTML)
    assert stale.headers["location"] == "/#login=stale"


@pytest.mark.parametrize("to", ["/", "/?meeting=m", "/?recording=r&size=256", "/?meeting=%2F%2Fx"])
async def test_one_comes_back_to_where_one_was(ada, to):
    back = await come_back(ada, await leave_for(ada, to=to))
    assert back.headers["location"] == f"{to}#login=done"


@pytest.mark.parametrize(
    "to",
    [
        "//evil.example",
        "/\\evil.example",
        "https://evil.example/",
        "javascript:alert(1)",
        "/.evil.example",
        "/v1/logout",
        "/?x\r\nSet-Cookie: a=b",
        "/?x\n",
        "/?x#token=of-somebody",
        "/?x\\y",
        "/?é",
        "?meeting=m",
        "",
        "/?" + "x" * 1000,
    ],
)
async def test_nobody_is_sent_to_another_place(ada, provider, to):
    for headers in ({}, HTML):
        refused = await ada.get("/v1/login", params={"to": to}, headers=headers)
        assert (refused.status_code, refused.headers.get("location")) == (422, None)
    assert provider.asked == []


async def test_logging_out_ends_the_providers_session_too_where_it_can(services, ada, provider):
    out = await ada.get("/v1/logout")
    url = httpx.URL(out.headers["location"])
    assert (out.status_code, url.path) == (302, "/logout")
    assert dict(url.params) == {"client_id": CLIENT_ID, "post_logout_redirect_uri": f"{BASE}/"}
    assert httpx.get(str(url)).headers["location"] == f"{BASE}/"
    provider.metadata = {"end_session_endpoint": None}
    async with browser(build_services(services.settings)) as other:
        assert (await other.get("/v1/logout")).headers["location"] == "/"


async def test_without_a_provider_nobody_logs_in(settings):
    services = build_services(settings)
    async with browser(services) as client:
        assert (await client.get("/v1/access")).json() == {"guests": True, "login": False}
        for method, path in (("GET", ""), ("GET", "/callback"), ("POST", "/token")):
            refused = await client.request(method, f"/v1/login{path}", headers=HTML)
            told = (refused.status_code, refused.json()["type"])
            assert told == (403, "urn:metanerf:login-not-offered")
    services.close()


async def test_logins_are_limited_in_rate(services, provider):
    security = services.settings.security.model_copy(update={"guest_tokens_per_minute": 2})
    services = build_services(replace(services.settings, security=security))
    async with browser(services) as client:
        told = [(await client.get("/v1/login")).status_code for _ in range(3)]
    assert told == [302, 302, 429]
    # its description is asked for once
    assert provider.asked == ["/.well-known/openid-configuration"]


def test_whatever_comes_back_no_route_fails(services):
    text = st.text(st.characters(exclude_categories=["Cs"]), max_size=60)
    asked = st.dictionaries(st.sampled_from(["state", "code", "error", "iss"]), text)

    async def begin() -> tuple[str, str]:
        async with browser(services) as client:
            address = httpx.URL(await leave_for(client))
            return address.params["state"], client.cookies["metanerf_login"]

    async def answer(query: dict[str, str], cookie: str, headers: dict[str, str]) -> httpx.Response:
        async with browser(services) as client:
            client.cookies.set("metanerf_login", cookie)
            return await client.get("/v1/login/callback", params=query, headers=headers)

    with asyncio.Runner() as runner:
        state, ticket = runner.run(begin())
        cookies = [ticket, ticket[:-2], "", "a.b.c", "x" * 3000]

        @hypothesis.settings(max_examples=60, derandomize=True, database=None)
        @given(
            query=asked,
            ours=st.booleans(),
            cookie=st.sampled_from(cookies),
            headers=st.sampled_from([HTML, {}]),
        )
        def attack(query: dict[str, str], ours: bool, cookie: str, headers: dict[str, str]) -> None:
            told = runner.run(answer({**query, "state": state} if ours else query, cookie, headers))
            assert told.status_code in {302, 400, 403, 422, 429, 502}, told.text
            where = told.headers.get("location", "/#login=")
            assert where.startswith("/#login=")
            assert not where.endswith("done")

        attack()
