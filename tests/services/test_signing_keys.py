"""A secret is replaced while what the one before signed goes on to hold."""

from __future__ import annotations

from datetime import timedelta
from itertools import pairwise

import httpx
import jwt
import pytest
from pydantic import SecretStr

from services.app import create_app
from services.auth import ALL_SCOPES, Tokens
from services.composition import build_services
from services.errors import LoginStale, Unauthorized
from services.settings import Settings
from services.signing_keys import SigningKeys
from services.tickets import Tickets
from tests.fakes import Clock
from tests.services.conftest import bearer, changed

OLD, NEW, FOREIGN = "old" * 16, "new" * 16, "foreign" * 8


def token(keys: SigningKeys) -> str:
    return Tokens(keys, Clock()).issue("house", ALL_SCOPES, timedelta(hours=1))[0]


def test_gateways_replaced_one_after_the_other_know_each_others_tokens():
    # as docs/operate.md tells it, and each step beside the one before
    steps = [
        SigningKeys(OLD),
        SigningKeys(OLD, [NEW]),
        SigningKeys(NEW, [OLD]),
        SigningKeys(NEW),
    ]
    for before, after in pairwise(steps[:-1]):
        for signs, reads in ((before, after), (after, before)):
            assert Tokens(reads, Clock()).read(token(signs)).account == "house"
    assert Tokens(steps[3], Clock()).read(token(steps[2])).account == "house"
    with pytest.raises(Unauthorized, match="no longer, this server's"):
        Tokens(steps[3], Clock()).read(token(steps[1]))


def test_a_token_names_its_key_and_not_its_secret():
    ids = [jwt.get_unverified_header(token(SigningKeys(one)))["kid"] for one in (OLD, NEW, OLD)]
    assert ids[0] == ids[2] != ids[1]
    assert len(ids[0]) == 8
    assert ids[1] not in NEW


@pytest.mark.parametrize("keys", [SigningKeys(OLD), SigningKeys(NEW, [FOREIGN, OLD])])
def test_tokens_from_before_keys_had_names_hold(keys: SigningKeys):
    claims = jwt.decode(token(SigningKeys(OLD)), options={"verify_signature": False})
    nameless = jwt.encode(claims, OLD, "HS256")
    assert Tokens(keys, Clock()).read(nameless).account == "house"
    with pytest.raises(Unauthorized, match="signed by this server"):
        Tokens(keys, Clock()).read(jwt.encode(claims, "nobody" * 8, "HS256"))


def test_another_keys_name_opens_nothing():
    claims = jwt.decode(token(SigningKeys(OLD)), options={"verify_signature": False})
    name = jwt.get_unverified_header(token(SigningKeys(OLD)))["kid"]
    for header in ({"kid": name}, {"kid": "ffffffff"}, {"kid": ""}):
        forged = jwt.encode(claims, FOREIGN, "HS256", headers=header)
        with pytest.raises(Unauthorized):
            Tokens(SigningKeys(NEW, [OLD]), Clock()).read(forged)


def test_a_login_that_began_before_is_ended_after():
    ticket = Tickets(SigningKeys(OLD), Clock()).write("login", timedelta(minutes=10), state="s")
    after = SigningKeys(NEW, [OLD])
    assert Tickets(after, Clock()).read("login", ticket) == {"state": "s"}
    with pytest.raises(LoginStale):
        Tickets(SigningKeys(NEW), Clock()).read("login", ticket)
    # neither passes for the other
    with pytest.raises(Unauthorized):
        Tokens(after, Clock()).read(ticket)
    with pytest.raises(LoginStale):
        Tickets(after, Clock()).read("login", token(after))


async def test_a_server_with_another_secret_throws_nobody_out(settings: Settings):
    before = build_services(changed(settings, jwt_secret=None))
    headers = bearer(before)
    before.close()
    secret = (settings.folders.data_dir / "jwt_secret").read_text()
    for others, status in ((f"{FOREIGN}\n{secret}\n", 200), (FOREIGN, 401)):
        rotated = changed(settings, jwt_secret=SecretStr(NEW), jwt_other_secrets=SecretStr(others))
        services = build_services(rotated)
        services.database.migrate()
        transport = httpx.ASGITransport(create_app(services), raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://test") as caller:
            assert (await caller.get("/v1/people", headers=headers)).status_code == status
        services.close()
