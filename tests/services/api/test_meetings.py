"""Meetings: who stands where, who may come in, and what the demo shows."""

from __future__ import annotations

import json
import math
from pathlib import Path

import httpx
import numpy as np
import pytest

from db.models import ModelRow
from services.app import create_app
from services.auth import GUEST
from services.bootstrap import ensure_demo, import_model
from services.container import Services
from services.gateway import gateway_of
from services.live.eye_level import with_level_gaze
from services.live.room import Room
from services.live.sessions.stored_meetings import load_performers
from tests.services import seeds
from tests.services.conftest import bearer, changed


@pytest.fixture
def models(services: Services, model_file: Path) -> list[ModelRow]:
    return [seeds.imported(services, model_file, "house", name) for name in ("Ada", "Bob", "Cy")]


async def test_a_meeting_places_its_performers_apart(
    client: httpx.AsyncClient, models: list[ModelRow]
):
    ids = [model.id for model in models]
    opened = await client.post("/v1/meetings", json={"name": "Monday", "model_ids": ids})
    assert opened.status_code == 201
    meeting = opened.json()
    assert [p["name"] for p in meeting["performers"]] == ["Ada", "Bob", "Cy"]
    assert meeting["join_url"] == f"/?meeting={meeting['id']}"
    places = [p["position"] for p in meeting["performers"]]
    apart = [math.dist(a, b) for i, a in enumerate(places) for b in places[:i]]
    assert min(apart) > 0.5
    assert meeting.pop("host_token")
    assert (await client.get(f"/v1/meetings/{meeting['id']}")).json() == meeting


async def test_performers_come_and_go_and_live_views_follow(
    services: Services, models: list[ModelRow], monkeypatch: pytest.MonkeyPatch
):
    app = create_app(services)
    heard: list[str] = []

    async def listener(meeting_id: str) -> None:
        heard.append(meeting_id)

    monkeypatch.setattr(gateway_of(app).views, "refresh", listener)
    async with httpx.AsyncClient(
        transport=httpx.ASGITransport(app), base_url="http://test", headers=bearer(services)
    ) as client:
        meeting = (await client.post("/v1/meetings", json={"name": "Monday"})).json()
        path = f"/v1/meetings/{meeting['id']}/performers"
        ada = await client.post(path, json={"model_id": models[0].id})
        assert ada.status_code == 201
        assert ada.json()["position"] == [0.0, 0.0, 0.0]
        bob = (await client.post(path, json={"model_id": models[1].id})).json()
        gone = await client.delete(f"{path}/{ada.json()['id']}")
        assert gone.status_code == 204
        assert (await client.delete(f"{path}/{ada.json()['id']}")).status_code == 404
        left = (await client.get(f"/v1/meetings/{meeting['id']}")).json()["performers"]
        assert left == [bob]  # who stays does not move
        again = (await client.post(path, json={"model_id": models[0].id})).json()
        assert again["position"] == [0.0, 0.0, 0.0]
        await client.delete(f"{path}/{again['id']}")
        await client.delete(f"/v1/people/{models[1].person_id}")
        left = (await client.get(f"/v1/meetings/{meeting['id']}")).json()["performers"]
        assert left == []
    assert heard == [meeting["id"]] * 6


async def test_joining_gives_a_seat_and_a_token_for_this_meeting_only(
    client: httpx.AsyncClient, services: Services, models: list[ModelRow]
):
    body = {"name": "Monday", "model_ids": [models[0].id]}
    first = (await client.post("/v1/meetings", json=body)).json()["id"]
    second = (await client.post("/v1/meetings", json=body)).json()["id"]
    seats = [
        (await client.post(f"/v1/meetings/{first}/join", json={"display_name": name})).json()
        for name in ("Dee", "Eve")
    ]
    assert [seat["seat"] for seat in seats] == [1, 2]
    assert seats[0]["whep_url"] == f"/whep/{first}"
    assert seats[0]["ice_servers"] == []
    assert [p["name"] for p in seats[0]["performers"]] == ["Ada"]
    mine = {"Authorization": f"Bearer {seats[0]['token']}"}
    assert (await client.get(f"/v1/meetings/{first}", headers=mine)).status_code == 200
    other = await client.get(f"/v1/meetings/{second}", headers=mine)
    assert other.status_code == 403
    assert f"for meeting '{second}'" in other.json()["detail"]
    assert (await client.get("/v1/people", headers=mine)).status_code == 403
    changed = await client.post(
        f"/v1/meetings/{first}/performers",
        json={"model_id": models[1].id},
        headers=bearer(services, account="neighbours"),
    )
    assert changed.status_code == 403


async def test_a_link_lets_in_where_access_is_closed(services: Services, models: list[ModelRow]):
    closed = changed(services.settings, open_access=False, public_url="https://meet.example/")
    from dataclasses import replace

    app = create_app(replace(services, settings=closed))
    async with httpx.AsyncClient(
        transport=httpx.ASGITransport(app), base_url="http://test"
    ) as client:
        opened = await client.post(
            "/v1/meetings",
            json={"name": "Monday", "model_ids": [models[0].id]},
            headers=bearer(services),
        )
        url, token = opened.json()["join_url"].split("#token=")
        assert url == f"https://meet.example/?meeting={opened.json()['id']}"
        joined = await client.post(
            f"/v1/meetings/{opened.json()['id']}/join",
            json={},
            headers={"Authorization": f"Bearer {token}"},
        )
        assert joined.status_code == 200
        refused = await client.post("/v1/guest")
        assert refused.status_code == 403
        assert (await client.get("/v1/demo")).json() == {"meeting_id": None}


async def test_unknown_models_open_no_meeting(client: httpx.AsyncClient):
    answer = await client.post("/v1/meetings", json={"name": "Monday", "model_ids": ["none"]})
    assert answer.status_code == 404


async def test_the_demo_is_made_once_and_heals(
    client: httpx.AsyncClient, services: Services, model_file: Path
):
    assert (await client.get("/v1/demo")).json() == {"meeting_id": None}
    meeting_id = ensure_demo(services, model_file, "Robin")
    assert ensure_demo(services, model_file, "Robin") == meeting_id
    assert (await client.get("/v1/demo")).json() == {"meeting_id": meeting_id}
    guest = {"Authorization": f"Bearer {(await client.post('/v1/guest')).json()['token']}"}
    (person,) = (await client.get("/v1/people", headers=guest)).json()["items"]
    assert person["mine"] is False
    refused = await client.delete(f"/v1/people/{person['id']}", headers=guest)
    assert refused.status_code == 403  # the demo's performer is no guest's to erase
    house = bearer(services, GUEST)
    assert (await client.delete(f"/v1/people/{person['id']}", headers=house)).status_code == 200
    assert ensure_demo(services, model_file, "Robin") == meeting_id
    meeting = (await client.get(f"/v1/meetings/{meeting_id}", headers=guest)).json()
    assert [p["name"] for p in meeting["performers"]] == ["Robin"]


async def test_whoever_takes_part_looks_from_their_own_place_and_others_from_the_front(
    client: httpx.AsyncClient, services: Services, model_file: Path
):
    meeting_id = ensure_demo(services, model_file, "Robin")
    tokens = [(await client.post("/v1/guest")).json()["token"] for _ in range(2)]
    speaker, watcher = ({"Authorization": f"Bearer {token}"} for token in tokens)
    account = services.tokens.read(tokens[0]).account
    model = import_model(services, model_file, account, "Robin")
    path = f"/v1/meetings/{meeting_id}"
    mine = await client.post(f"{path}/performers", json={"model_id": model.id}, headers=speaker)
    assert mine.json()["owner"] == "own"
    before = (await client.get(path, headers=watcher)).json()
    assert len(before["performers"]) == 1, "guests are shown while they are there"
    seat = await client.post(f"{path}/join", json={}, headers=speaker)
    own, seen = [(await client.get(path, headers=headers)).json() for headers in (speaker, watcher)]
    assert [p["owner"] for p in own["performers"]] == ["demo", "own"]
    assert [p["owner"] for p in seen["performers"]] == ["demo", "other"]
    x, _, z = own["viewpoint"]["target"]
    away = own["viewpoint"]["distance_m"] * math.cos(own["viewpoint"]["elevation_rad"])
    eye = (
        x + away * math.sin(own["viewpoint"]["azimuth_rad"]),
        z + away * math.cos(own["viewpoint"]["azimuth_rad"]),
    )
    assert eye == pytest.approx(own["performers"][1]["position"][::2])
    assert seen["viewpoint"]["azimuth_rad"] == pytest.approx(math.pi / 3)
    assert seat.json()["viewpoint"] == own["viewpoint"]
    # who brought two into a meeting of theirs is asked which they are, and till then only watches
    opened = await client.post(
        "/v1/meetings", json={"name": "Two", "model_ids": [model.id, model.id]}, headers=speaker
    )
    path = f"/v1/meetings/{opened.json()['id']}"
    own, seen = [(await client.get(path, headers=headers)).json() for headers in (speaker, watcher)]
    assert own["viewpoint"] == seen["viewpoint"]


async def _keypoints(client: httpx.AsyncClient, person_id: str) -> str:
    file = {"file": ("wave.json", json.dumps(seeds.keypoints(30, angle=0.8)))}
    answer = await client.post(f"/v1/people/{person_id}/sequences", files=file)
    assert answer.json()["state"] == "ready"
    return answer.json()["id"]


async def test_keypoints_move_a_performer_until_they_are_erased(
    client: httpx.AsyncClient,
    services: Services,
    models: list[ModelRow],
    monkeypatch: pytest.MonkeyPatch,
):
    app = create_app(services)
    heard: list[str] = []

    async def listener(meeting_id: str) -> None:
        heard.append(meeting_id)

    monkeypatch.setattr(gateway_of(app).views, "refresh", listener)
    ada, bob, _ = models
    meeting = (await client.post("/v1/meetings", json={"name": "Monday"})).json()
    motion = await _keypoints(client, bob.person_id)
    body = {"model_id": ada.id, "motion_sequence_id": motion}
    moved = await client.post(f"/v1/meetings/{meeting['id']}/performers", json=body)
    assert moved.status_code == 201, moved.text
    assert moved.json()["motion_sequence_id"] == motion
    (member,) = load_performers(services, meeting["id"])
    np.testing.assert_allclose(member.motion.joint_angles[:, 5, 2], 0.8)
    room = Room(meeting["id"], (member,))
    np.testing.assert_allclose(room.scene_at(0.5).performers[0].pose.joint_angles[5, 2], 0.8)
    async with httpx.AsyncClient(
        transport=httpx.ASGITransport(app), base_url="http://test", headers=bearer(services)
    ) as caller:
        await caller.delete(f"/v1/people/{bob.person_id}")
    assert heard == [meeting["id"]]
    (member,) = load_performers(services, meeting["id"])
    own = with_level_gaze(member.model.skeleton, member.model.motion)
    np.testing.assert_array_equal(member.motion.joint_angles, own.joint_angles)


async def test_only_ready_motions_of_ones_own_move_anybody(
    client: httpx.AsyncClient, services: Services, models: list[ModelRow]
):
    meeting = (await client.post("/v1/meetings", json={"name": "Monday"})).json()
    path = f"/v1/meetings/{meeting['id']}/performers"
    upload = {"file": ("a.zip", seeds.frames_archive())}
    clip = await client.post(f"/v1/people/{models[0].person_id}/sequences", files=upload)
    body = {"model_id": models[0].id, "motion_sequence_id": clip.json()["id"]}
    waiting = await client.post(path, json=body)
    assert waiting.status_code == 409
    assert "wait for its capture" in waiting.json()["detail"]
    neighbours = bearer(services, account="neighbours")
    stranger = await client.post("/v1/people", json={"name": "Dee"}, headers=neighbours)
    client.headers.update(neighbours)
    body["motion_sequence_id"] = await _keypoints(client, stranger.json()["id"])
    client.headers.update(bearer(services))
    assert (await client.post(path, json=body)).status_code == 403
    left = (await client.get(f"/v1/meetings/{meeting['id']}")).json()["performers"]
    assert left == []
