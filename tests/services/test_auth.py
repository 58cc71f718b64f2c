"""Tokens: none, foreign, over, too weak, or of another account."""

from __future__ import annotations

from datetime import timedelta

import httpx
import jwt
import pytest

from services.auth import ALL_SCOPES, Tokens
from services.container import Services
from services.errors import Unauthorized
from services.signing_keys import SigningKeys
from tests.fakes import Clock
from tests.services.conftest import bearer


def test_a_token_is_over_when_its_time_is():
    clock = Clock()
    tokens = Tokens(SigningKeys("k" * 40), clock)
    token, expires = tokens.issue("house", ALL_SCOPES, timedelta(hours=1))
    assert tokens.read(token).account == "house"
    assert expires - clock() == timedelta(hours=1)
    clock.advance(hours=1)
    with pytest.raises(Unauthorized, match="the token must not be over"):
        tokens.read(token)


@pytest.mark.parametrize(
    "token",
    [
        "nonsense",
        jwt.encode({"sub": "house", "iss": "metanerf", "exp": 9e9, "scope": "read"}, "other" * 9),
        jwt.encode({"sub": "house", "iss": "metanerf", "exp": 9e9, "scope": "read"}, "", "none"),
    ],
)
def test_foreign_tokens_are_refused(token: str):
    with pytest.raises(Unauthorized, match="must be signed by this server"):
        Tokens(SigningKeys("k" * 40), Clock()).read(token)


async def test_no_token_is_told_how_to_send_one(client: httpx.AsyncClient):
    answer = await client.get("/v1/people", headers={"Authorization": ""})
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == "Bearer"
    assert answer.headers["content-type"] == "application/problem+json"
    assert "Authorization: Bearer TOKEN" in answer.json()["detail"]


async def test_a_token_needs_the_scope(client: httpx.AsyncClient, services: Services):
    looks = bearer(services, scopes=frozenset({"read"}))
    assert (await client.get("/v1/people", headers=looks)).status_code == 200
    answer = await client.post("/v1/people", json={"name": "Ada"}, headers=looks)
    assert answer.status_code == 403
    assert "scope 'write'; got ['read']" in answer.json()["detail"]


async def test_people_of_another_account_stay_closed(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    other = bearer(services, account="neighbours")
    assert (await client.get("/v1/people", headers=other)).json() == {"items": []}
    for method in ("GET", "DELETE"):
        answer = await client.request(method, f"/v1/people/{person_id}", headers=other)
        assert answer.status_code == 403
    assert (await client.get(f"/v1/people/{person_id}")).status_code == 200


async def test_guests_come_in_only_where_access_is_open(client: httpx.AsyncClient):
    answer = await client.post("/v1/guest")
    assert answer.status_code == 201
    guest = {"Authorization": f"Bearer {answer.json()['token']}"}
    assert (await client.get("/v1/people", headers=guest)).status_code == 200
