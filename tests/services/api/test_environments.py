"""The library of environments: what it lists, and the pictures behind it."""

from __future__ import annotations

import cv2
import numpy as np

from db.models import Role
from scene.lighting import LUMINANCE, panorama_directions
from services.api.environments import LARGEST_PICTURE_BYTES
from services.environments import environment, themes
from services.live.sessions.stored_meetings import load_environment
from tests.services.conftest import bearer


async def test_the_library_lists_places_and_their_light(client):
    listed = (await client.get("/v1/environments")).json()["items"]
    assert [one["name"] for one in listed] == ["studio", "apartment", "lobby", "park"]
    studio, *places = listed
    assert studio["light"] is None
    assert studio["picture_url"] is None
    for place in places:
        assert len(place["light"]["harmonics"]) == 9
        answer = await client.get(place["picture_url"], headers={"Authorization": ""})
        picture = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        assert picture.shape[1] == 2 * picture.shape[0]
        kept = await client.get(
            place["picture_url"], headers={"If-None-Match": answer.headers["etag"]}
        )
        assert kept.status_code == 304


async def test_a_place_that_is_not_there_is_said(client):
    answer = await client.get("/v1/environments/moon/picture")
    assert answer.status_code == 404
    assert "studio, apartment, lobby, park; got 'moon'" in answer.json()["detail"]
    plain = await client.get("/v1/environments/studio/picture")
    assert "a plain room" in plain.json()["detail"]


def test_every_theme_is_exposed_for_people():
    normals = panorama_directions(16, 32).reshape(-1, 3)
    for name in themes():
        lighting = environment(name).lighting
        if lighting is not None:
            assert 0.95 < (lighting.shading(normals) @ LUMINANCE).max() < 1.05


async def test_the_owner_chooses_a_place_and_the_meeting_keeps_it(client):
    meeting = (await client.post("/v1/meetings", json={"name": "Monday"})).json()
    assert meeting["environment"] == "studio"
    path = f"/v1/meetings/{meeting['id']}"
    chosen = await client.put(f"{path}/environment", json={"name": "lobby"})
    assert chosen.status_code == 200
    assert chosen.json()["light"] is not None
    assert (await client.get(path)).json()["environment"] == "lobby"
    unknown = await client.put(f"{path}/environment", json={"name": "moon"})
    assert unknown.status_code == 404
    assert (await client.get(path)).json()["environment"] == "lobby"


def panorama(width: int = 64) -> bytes:
    """A picture of a place with a red sky and a bright spot over it."""
    pixels = np.full((width // 2, width, 3), 60, np.uint8)
    pixels[: width // 4, :, 2] = 200
    pixels[2:5, 10:14] = 255
    return cv2.imencode(".png", pixels)[1].tobytes()


async def test_the_host_brings_a_place_along_and_comes_back_to_it(client, services):
    meeting = (await client.post("/v1/meetings", json={"name": "Monday"})).json()
    path = f"/v1/meetings/{meeting['id']}"
    assert (await client.get(f"{path}/panorama")).status_code == 404
    brought = await client.put(f"{path}/panorama", content=panorama())
    assert brought.status_code == 200, brought.text
    place = brought.json()
    assert place["title"] == "Our own"
    assert sum(place["light"]["key_colour"]) > 0.0
    assert (await client.get(f"{path}/environment")).json() == place
    answer = await client.get(place["picture_url"])
    shown = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None
    assert shown.shape == (32, 64, 3)
    kept = await client.get(place["picture_url"], headers={"If-None-Match": answer.headers["etag"]})
    assert kept.status_code == 304
    drawn = load_environment(services, meeting["id"])
    assert drawn.panorama is not None
    assert drawn.lighting is not None
    assert drawn.panorama[2, 40, 0] > 2.0 * drawn.panorama[30, 40, 0]
    for name in ("park", place["name"]):
        assert (await client.put(f"{path}/environment", json={"name": name})).status_code == 200
        assert (await client.get(f"{path}/environment")).json()["name"] == name
    other = (await client.post("/v1/meetings", json={"name": "Tuesday"})).json()
    elsewhere = f"/v1/meetings/{other['id']}/environment"
    assert (await client.put(elsewhere, json={"name": place["name"]})).status_code == 404


async def test_what_is_no_panorama_changes_nothing(client, services):
    meeting = (await client.post("/v1/meetings", json={"name": "Monday"})).json()
    path = f"/v1/meetings/{meeting['id']}"
    square = cv2.imencode(".png", np.full((8, 8, 3), 9, np.uint8))[1].tobytes()
    black = cv2.imencode(".png", np.zeros((8, 16, 3), np.uint8))[1].tobytes()
    told = {}
    for name, data in (("text", b"dear diary"), ("square", square), ("black", black), ("", b"")):
        answer = await client.put(f"{path}/panorama", content=data)
        assert answer.status_code == 422, answer.text
        told[name] = answer.json()["detail"]
    assert "twice as wide as high (equirectangular); got 8 x 8" in told["square"]
    assert "must give light" in told["black"]
    large = await client.put(f"{path}/panorama", content=bytes(LARGEST_PICTURE_BYTES + 1))
    assert large.status_code == 413
    stranger = bearer(services, "another")
    answer = await client.put(f"{path}/panorama", content=panorama(), headers=stranger)
    assert answer.status_code == 403
    assert (await client.get(path)).json()["environment"] == "studio"


async def test_only_the_host_chooses(client, services):
    meeting = (await client.post("/v1/meetings", json={"name": "Monday"})).json()
    path = f"/v1/meetings/{meeting['id']}"
    seats = [
        (await client.post(f"{path}/join", json={"display_name": name})).json()
        for name in ("Ada", "Bo")
    ]
    with services.unit_of_work() as unit:
        unit.meetings.get_for_change(meeting["id"]).participants[0].role = Role.HOST
        unit.commit()
    statuses = []
    for seat in seats:
        header = {"Authorization": f"Bearer {seat['token']}"}
        answer = await client.put(f"{path}/environment", json={"name": "park"}, headers=header)
        statuses.append(answer.status_code)
    assert statuses == [200, 403]
    assert "of the meeting's host" in answer.json()["detail"]
    stranger = bearer(services, "another")
    answer = await client.put(f"{path}/environment", json={"name": "park"}, headers=stranger)
    assert answer.status_code == 403
    reader = bearer(services, scopes=frozenset({"join"}))
    answer = await client.put(f"{path}/environment", json={"name": "park"}, headers=reader)
    assert answer.status_code == 403
