"""Models: files by hash, views from any side in any pose, and what is refused."""

from __future__ import annotations

import hashlib
import json
import shutil
import uuid
from pathlib import Path

import cv2
import httpx
import numpy as np
import pytest
from pydantic import SecretStr

from db.models import ModelRow
from renderer.splats.model import SplatModel
from services.composition import build_services
from services.container import Services
from services.settings import Settings
from tests.services import seeds
from tests.services.conftest import bearer, calling, changed


@pytest.fixture
def model(services: Services, model_file: Path) -> ModelRow:
    return seeds.imported(services, model_file, "house", "Ada")


def _pixels(answer: httpx.Response) -> np.ndarray:
    assert answer.status_code == 200, answer.text
    pixels = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert pixels is not None
    return pixels


async def _view(client: httpx.AsyncClient, model: ModelRow, **body: object) -> httpx.Response:
    asked = {"width": 96, "height": 128} | body
    return await client.post(
        f"/v1/models/{model.id}/views",
        content=json.dumps(asked),
        headers={"Content-Type": "application/json"},
    )


async def test_a_model_is_read_and_listed(client: httpx.AsyncClient, model: ModelRow):
    read = (await client.get(f"/v1/models/{model.id}")).json()
    assert read["preset"] == "splats"
    assert read["metrics"]["steps"] == 5
    assert (await client.get("/v1/models")).json()["items"] == [read]
    file, splats, drawn = read["files"]
    assert (splats["name"], drawn["name"]) == ("splats.ply", "viewer.splats")
    assert (await client.get(drawn["url"])).content.startswith(b"MNSP")
    assert (await client.get(splats["url"])).content.startswith(b"ply\nformat binary")
    fetched = await client.get(file["url"])
    assert hashlib.sha256(fetched.content).hexdigest() == read["sha256"]
    assert fetched.headers["etag"] == f'"{read["sha256"]}"'
    assert fetched.headers["content-length"] == str(read["bytes"])
    kept = await client.get(file["url"], headers={"If-None-Match": fetched.headers["etag"]})
    assert (kept.status_code, kept.content) == (304, b"")
    missing = await client.get(f"/v1/models/{model.id}/files/..%2Fsecret")
    assert missing.status_code == 404


async def test_a_view_shows_a_whole_person_cut_out(client: httpx.AsyncClient, model: ModelRow):
    pixels = _pixels(await _view(client, model))
    assert pixels.shape == (128, 96, 4)
    alpha = pixels[..., 3]
    rows = np.flatnonzero(alpha.max(axis=1) > 128)
    assert rows.size > 60
    assert rows[0] > 1
    assert rows[-1] < 126
    assert alpha[0, 0] == 0


async def test_views_follow_camera_pose_and_background(client: httpx.AsyncClient, model: ModelRow):
    front = _pixels(await _view(client, model, background=[0, 0, 1], format="png"))
    assert front.shape == (128, 96, 3)
    assert front[0, 0].tolist() == [255, 0, 0]  # OpenCV reads BGR
    side = await _view(client, model, background=[0, 0, 1], camera={"orbit": {"azimuth_deg": 90}})
    assert np.abs(_pixels(side).astype(int) - front).mean() > 1.0
    squat = [[0.0] * 3 for _ in range(24)]
    squat[1] = squat[2] = [-1.2, 0.0, 0.0]
    posed = await _view(client, model, background=[0, 0, 1], pose={"joint_angles": squat})
    assert np.abs(_pixels(posed).astype(int) - front).mean() > 1.0
    later = await _view(client, model, background=[0, 0, 1], time_s=0.1)
    assert np.abs(_pixels(later).astype(int) - front).mean() > 0.05


@pytest.mark.parametrize(("kind", "mark"), [("jpeg", b"\xff\xd8"), ("webp", b"RIFF")])
async def test_views_in_other_formats(
    client: httpx.AsyncClient, model: ModelRow, kind: str, mark: bytes
):
    answer = await _view(client, model, format=kind)
    assert answer.headers["content-type"] == f"image/{kind}"
    assert answer.content.startswith(mark)
    if kind == "jpeg":
        assert _pixels(answer)[0, 0].min() > 250


async def test_a_camera_by_matrices(client: httpx.AsyncClient, model: ModelRow):
    camera = {
        "intrinsics": [[200, 0, 48], [0, 200, 64], [0, 0, 1]],
        "world_to_camera": [[1, 0, 0, 0], [0, -1, 0, 0.9], [0, 0, -1, 4]],
    }
    assert _pixels(await _view(client, model, camera=camera))[..., 3].max() > 128


SINGULAR = {
    "intrinsics": [[0, 0, 48], [0, 0, 64], [0, 0, 0]],
    "world_to_camera": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4]],
}
FLAT = {
    "intrinsics": [[200, 0, 48], [0, 200, 64], [0, 0, 1]],
    "world_to_camera": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 4]],
}
NAN = float("nan")


@pytest.mark.parametrize(
    ("body", "told"),
    [
        ({"camera": SINGULAR}, "intrinsics must be invertible"),
        ({"camera": FLAT}, "world_to_camera must hold a rotation"),
        ({"camera": {"intrinsics": SINGULAR["intrinsics"]}}, "together"),
        ({"camera": {**FLAT, "intrinsics": [[1, 2], [3]]}}, "rows of unequal length"),
        ({"pose": {"joint_angles": [[0, 0, NAN]] * 24}}, "joint_angles must be finite; got nan"),
        ({"pose": {"joint_angles": [[0, 0, 0]] * 23}}, "joint_angles must be 24 x 3"),
        ({"pose": {"joint_angles": []}}, "joint_angles must be 24 x 3"),
        ({"camera": {**SINGULAR, "intrinsics": []}}, "intrinsics must be 3 x 3"),
        ({"pose": {"joint_angles": [[0, 0, 0]] * 24, "root_translation": [0, NAN, 0]}}, "finite"),
        (
            {"pose": {"joint_angles": [[0, 0, 0]] * 24, "expression": [0.5]}},
            "expression must be 17",
        ),
        ({"pose": {"joint_angles": [[0, 0, 0]] * 24, "expression": [2] * 7}}, "expression"),
        ({"time_s": NAN}, "time_s"),
        ({"camera": {"orbit": {"azimuth_deg": NAN}}}, "azimuth_deg"),
        ({"width": 4000}, "at most 2048 px; got 4000"),
        ({"width": 0}, "width"),
        ({"format": "gif"}, "format"),
        ({"background": [2, 0, 0]}, "background"),
    ],
)
async def test_bad_views_are_told(
    client: httpx.AsyncClient, model: ModelRow, body: dict, told: str
):
    answer = await _view(client, model, **body)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert told in answer.json()["detail"]


async def test_keypoints_drive_a_model(client: httpx.AsyncClient, model: ModelRow):
    data = json.dumps(seeds.keypoints(4, angle=0.8)).encode()
    uploaded = await client.post(
        f"/v1/people/{model.person_id}/sequences", files={"file": ("wave.json", data)}
    )
    own = _pixels(await _view(client, model))
    driven = await _view(client, model, motion_sequence_id=uploaded.json()["id"])
    assert np.abs(_pixels(driven).astype(int) - own).mean() > 1.0
    unknown = await _view(client, model, motion_sequence_id="none")
    assert unknown.status_code == 404


async def test_models_of_others_stay_closed(
    client: httpx.AsyncClient, services: Services, model: ModelRow
):
    other = bearer(services, account="neighbours")
    for path in (f"/v1/models/{model.id}", f"/v1/models/{model.id}/files/model.safetensors"):
        assert (await client.get(path, headers=other)).status_code == 403
    view = await client.post(f"/v1/models/{model.id}/views", json={}, headers=other)
    assert view.status_code == 403


async def test_an_erased_model_is_gone_from_memory_too(client: httpx.AsyncClient, model: ModelRow):
    assert (await _view(client, model)).status_code == 200
    assert (await client.delete(f"/v1/people/{model.person_id}")).json()["remaining"] == 0
    assert (await _view(client, model)).status_code == 404


async def test_depth_may_be_asked_for_in_millimetres(client: httpx.AsyncClient, model: ModelRow):
    orbit = {"orbit": {"distance_m": 3.0}}
    view = await _view(client, model, shows="depth", camera=orbit)
    assert view.headers["content-type"] == "image/png"
    depth = _pixels(view)
    assert depth.dtype == np.uint16
    assert 2000 < np.median(depth[depth > 0]) < 4000
    refused = await _view(client, model, shows="depth", format="jpeg")
    assert refused.status_code == 422
    assert "must be asked for as png" in refused.json()["detail"]


async def test_parts_never_filmed_fade_out_unless_they_are_asked_for(
    client: httpx.AsyncClient, services: Services, model: ModelRow
):
    loaded = services.models.load_row(model)
    assert isinstance(loaded, SplatModel)
    loaded.seen[loaded.parameters[:, 1] < 0.8] = False  # as if filmed sitting at a desk
    whole = _pixels(await _view(client, model, hide_unseen=False))[..., 3].astype(int)
    alone = _pixels(await _view(client, model))[..., 3].astype(int)
    assert alone[100:].sum() < 0.05 * whole[100:].sum()
    assert alone[:50].sum() > 0.98 * whole[:50].sum()
    soft = (alone > 25) & (alone < 0.7 * whole)
    assert soft[50:90].any(axis=1).sum() >= 2  # rows over which the body fades
    refused = await _view(client, model, hide_unseen="some")
    assert refused.status_code == 422


async def test_a_file_is_read_from_a_store_that_clients_reach(
    settings: Settings, empty_database: Path, model_file: Path, s3_endpoint: str
):
    at_s3 = changed(
        settings,
        object_store_url=f"s3://test/{uuid.uuid4().hex}",
        s3_endpoint_url=s3_endpoint,
        s3_public_url=s3_endpoint.replace("127.0.0.1", "localhost"),
        s3_access_key_id="a",
        s3_secret_access_key=SecretStr("of the store"),
    )
    services = build_services(at_s3)
    shutil.copy(empty_database, settings.folders.data_dir / "metanerf.db")
    model = seeds.imported(services, model_file, "house", "Ada")
    async with calling(services) as client, httpx.AsyncClient() as anybody:
        read = (await client.get(f"/v1/models/{model.id}")).json()
        file, _, drawn = read["files"]
        sent_on = await client.get(file["url"])
        assert (sent_on.status_code, sent_on.headers["cache-control"]) == (307, "no-store")
        address = httpx.URL(sent_on.headers["location"])
        assert address.host == "localhost"
        assert address.params["X-Amz-Expires"] == "60"
        assert "of the store" not in str(address)
        fetched = await anybody.get(address)
        assert fetched.status_code == 200
        assert hashlib.sha256(fetched.content).hexdigest() == read["sha256"]
        etag = {"If-None-Match": f'"{read["sha256"]}"'}
        assert (await client.get(file["url"], headers=etag)).status_code == 304
        # pages draw what the gateway itself sends: they may speak to no other host
        assert (await client.get(drawn["url"])).content.startswith(b"MNSP")
        # nobody is told an address who may not have the model
        another = await client.get(file["url"], headers=bearer(services, "another"))
        assert another.status_code == 403
        assert "location" not in another.headers
        assert (await client.get(f"/v1/models/{model.id}/files/none")).status_code == 404
    services.close()
