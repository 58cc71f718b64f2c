"""Each guest is somebody of their own: what is theirs, nobody else changes, and a ban holds."""

from __future__ import annotations

from datetime import timedelta

import httpx
import pytest

from db.models import JobKind, JobState, SequenceState
from services.auth import ALL_SCOPES, GUEST, Principal, Tokens
from services.bootstrap import ensure_demo, import_model
from services.container import Services
from services.errors import NotOwner, Unauthorized
from services.jobs.queue import drop_orphans, enqueue, finish
from services.live.motion.driving_channels import drivable_performer
from services.live.room import Room
from services.live.sessions.stored_meetings import load_performers
from services.signing_keys import SigningKeys
from tests.db.rows import NOW, job, sequence
from tests.fakes import Clock
from tests.services.conftest import SECRET, bearer
from tests.services.control.page import join


async def guest(client: httpx.AsyncClient, last: str = "") -> tuple[dict[str, str], str]:
    """A guest's header and token."""
    header = {"Authorization": f"Bearer {last}"} if last else {"Authorization": ""}
    token = (await client.post("/v1/guest", headers=header)).json()["token"]
    return {"Authorization": f"Bearer {token}"}, token


async def test_a_guest_sees_and_changes_nothing_of_another(client, services, model_file):
    meeting_id = ensure_demo(services, model_file, "Robin")
    (ada, _), (bo, _) = await guest(client), await guest(client)
    person = (await client.post("/v1/people", json={"name": "Ada"}, headers=ada)).json()
    place = f"/v1/people/{person['id']}"
    for method in ("GET", "DELETE"):
        assert (await client.request(method, place, headers=bo)).status_code == 403
    account = services.tokens.read(ada["Authorization"].removeprefix("Bearer ")).account
    model = import_model(services, model_file, account, "Ada")
    brought = await client.post(
        f"/v1/meetings/{meeting_id}/performers", json={"model_id": model.id}, headers=ada
    )
    assert brought.status_code == 201
    performer = f"/v1/meetings/{meeting_id}/performers/{brought.json()['id']}"
    assert (await client.get(f"/v1/models/{model.id}", headers=bo)).status_code == 403
    assert (await client.delete(performer, headers=bo)).status_code == 403
    assert len(load_performers(services, meeting_id)) == 1, "shown once its owner is there"
    await client.post(f"/v1/meetings/{meeting_id}/join", json={"display_name": "Ada"}, headers=ada)
    room = Room(meeting_id, load_performers(services, meeting_id))
    robin, own = (one.performer_id for one in room.performers)
    stranger = services.tokens.read(bo["Authorization"].removeprefix("Bearer ")).account
    with pytest.raises(NotOwner, match="account whose person is driven"):
        drivable_performer(room, stranger, own)
    assert drivable_performer(room, account, own).name == "Ada"
    # the demo's performer is lent to all
    assert drivable_performer(room, stranger, robin).name == "Robin"
    with pytest.raises(NotOwner, match="account whose person is driven"):
        drivable_performer(room, "house", robin)
    (listed,) = (await client.get("/v1/people", headers=bo)).json()["items"]
    assert (listed["name"], listed["mine"]) == ("Robin", False)
    assert (await client.delete(performer, headers=ada)).status_code == 204


async def test_a_guest_who_brings_the_last_token_stays_who_they_were(client, services):
    (ada, token), (bo, _) = await guest(client), await guest(client)
    await client.post("/v1/people", json={"name": "Ada"}, headers=ada)
    again, _ = await guest(client, token)
    names = [one["name"] for one in (await client.get("/v1/people", headers=again)).json()["items"]]
    assert names == ["Ada"]
    assert (await client.get("/v1/people", headers=bo)).json()["items"] == []
    for none in ("nonsense", bearer(services)["Authorization"].removeprefix("Bearer ")):
        other, _ = await guest(client, none)
        assert (await client.get("/v1/people", headers=other)).json()["items"] == []


def test_a_token_that_ended_long_ago_says_nothing():
    clock = Clock()
    tokens = Tokens(SigningKeys(SECRET), clock)
    token, _ = tokens.issue("guest-1", ALL_SCOPES, timedelta(hours=1))
    clock.now += timedelta(days=30)
    with pytest.raises(Unauthorized, match="must not be over"):
        tokens.read(token)
    assert tokens.guest_of(token) == "guest-1"
    clock.now += timedelta(days=90)
    assert tokens.guest_of(token) is None
    seat, _ = tokens.issue("guest-1", ALL_SCOPES, timedelta(hours=1), meeting_id="m")
    assert tokens.guest_of(seat) is None


def test_only_guests_use_what_the_demo_lends():
    assert Principal("guest-1", ALL_SCOPES).may_use(GUEST)
    assert not Principal("house", ALL_SCOPES).may_use(GUEST)
    assert not Principal("guest-1", ALL_SCOPES).may_use("guest-2")


@pytest.mark.parametrize("lobby_again", [False, True])
async def test_whoever_is_sent_out_does_not_come_back_by_reloading(client, services, lobby_again):
    from services.app import create_app
    from tests.services.control.conftest import on_a_port

    async with on_a_port(create_app(services), services) as caller:
        meeting = (await caller.post("/v1/meetings", json={"name": "Monday"})).json()
        bo_header = bearer(services, "guest-bo")
        async with (
            await join(caller, meeting["id"], "Ada") as ada,
            await join(caller, meeting["id"], "Bo", headers=bo_header) as bo,
        ):
            members = await ada.roster(lambda who: len(who) == 2)
            await ada.say(type="remove", participant_id=members["Bo"]["id"])
            await bo.gone()
            if lobby_again:  # even where the host opens the door again
                await ada.say(type="lobby", on=False)
                await ada.beat()
            place = f"/v1/meetings/{meeting['id']}/join"
            back = await caller.post(place, json={}, headers=bo_header)
            assert back.status_code == 403
            assert "must not have been sent out" in back.json()["detail"]
            other = bearer(services, "guest-cy")
            assert (await caller.post(place, json={}, headers=other)).status_code == 200


def trained(services: Services, person_id: str, *, model_only: bool) -> str:
    """A captured clip from which a training has just succeeded."""
    clip = sequence(person_id)
    stored = [
        services.objects.put(person_id, [f"{kind} {model_only}".encode()]).sha256
        for kind in ("source", "packed", "thumbnail")
    ]
    clip.source_sha256, clip.packed_sha256, clip.thumbnail_sha256 = stored
    clip.state, clip.model_only = SequenceState.READY, model_only
    capture = job(person_id, JobKind.CAPTURE)
    capture.sequence_id, capture.state = clip.id, JobState.SUCCEEDED
    capture.preview, capture.preview_version = b"picture", 1
    with services.unit_of_work() as unit:
        unit.sequences.add(clip)
        unit.flush()
        unit.jobs.add(capture)
        training = enqueue(unit, JobKind.TRAIN, clip, {}, NOW)
        unit.flush()
        orphans = finish(unit, training, JobState.SUCCEEDED, NOW)
        unit.commit()
    drop_orphans(services, orphans)
    return clip.id


@pytest.mark.parametrize("model_only", [True, False])
async def test_the_clip_goes_once_trained_where_that_was_wished(
    client, services, person_id, model_only
):
    sequence_id = trained(services, person_id, model_only=model_only)
    left = len(list(services.objects.list(person_id)))
    read = (await client.get(f"/v1/sequences/{sequence_id}")).json()
    with services.reading() as unit:
        capture = unit.jobs.latest(sequence_id, JobKind.CAPTURE)
        assert capture is not None
        preview = unit.jobs.preview(capture.id)
    if not model_only:
        assert (left, read["state"], preview) == (3, "ready", b"picture")
        return
    assert (left, read["state"], preview) == (0, "forgotten", None)
    assert read["thumbnail_url"] is None
    again = await client.post(f"/v1/sequences/{sequence_id}/models", json={})
    assert again.status_code == 409
    assert "got forgotten" in again.json()["detail"]
