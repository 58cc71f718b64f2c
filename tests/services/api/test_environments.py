"""The library of environments: what it lists, and the pictures behind it."""

from __future__ import annotations

import cv2
import numpy as np

from scene.lighting import LUMINANCE, panorama_directions
from services.environments import environment, themes


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
