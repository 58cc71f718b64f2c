"""Uploads in pieces: go on after a break, never twice, never something else than was announced."""

from __future__ import annotations

import hashlib

import httpx
import pytest

from services.api import uploads
from services.container import Services
from tests.services import seeds
from tests.services.conftest import bearer, stored_files


async def _begin(client: httpx.AsyncClient, person_id: str, data: bytes) -> httpx.Response:
    body = {
        "filename": "me.mp4",
        "size": len(data),
        "sha256": hashlib.sha256(data).hexdigest(),
    }
    return await client.post(f"/v1/people/{person_id}/uploads", json=body)


async def _send(client: httpx.AsyncClient, upload_id: str, offset: int, data: bytes):
    return await client.patch(
        f"/v1/uploads/{upload_id}", content=data, headers={"Upload-Offset": str(offset)}
    )


async def test_pieces_become_a_sequence(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    data = seeds.video(30)
    begun = await _begin(client, person_id, data)
    assert begun.status_code == 201
    upload_id = begun.json()["id"]
    assert begun.json()["offset"] == 0
    half = len(data) // 2
    first = await _send(client, upload_id, 0, data[:half])
    assert (first.status_code, first.headers["upload-offset"]) == (204, str(half))
    asked = await client.head(f"/v1/uploads/{upload_id}")
    assert (asked.status_code, asked.headers["upload-offset"]) == (200, str(half))
    again = await _begin(client, person_id, data)
    assert again.json() == {"id": upload_id, "offset": half}
    last = await _send(client, upload_id, half, data[half:])
    assert last.status_code == 202
    sequence = last.json()
    assert (sequence["kind"], sequence["state"]) == ("video", "uploaded")
    assert [p.name for p in stored_files(services.settings)] == [sequence["sha256"]]
    assert (await client.head(f"/v1/uploads/{upload_id}")).status_code == 404
    known = await _begin(client, person_id, data)
    assert known.status_code == 200
    assert known.json()["sequence"]["id"] == sequence["id"]


@pytest.mark.parametrize("offset", [5, 100_000])
async def test_a_wrong_offset_is_told_where_to_go_on(
    client: httpx.AsyncClient, person_id: str, offset: int
):
    upload_id = (await _begin(client, person_id, seeds.video())).json()["id"]
    answer = await _send(client, upload_id, offset, b"xyz")
    assert answer.status_code == 409
    assert answer.headers["upload-offset"] == "0"
    assert f"got {offset}" in answer.json()["detail"]


async def test_more_than_announced_is_refused(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    data = seeds.video()
    upload_id = (await _begin(client, person_id, data)).json()["id"]
    assert (await _send(client, upload_id, 0, data + b"!")).status_code == 413
    assert stored_files(services.settings) == []


async def test_other_bytes_than_announced_leave_nothing(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    data = seeds.video()
    upload_id = (await _begin(client, person_id, data)).json()["id"]
    answer = await _send(client, upload_id, 0, bytes(len(data)))
    assert answer.status_code == 422
    assert "sha256 must be" in answer.json()["detail"]
    assert stored_files(services.settings) == []
    assert (await client.head(f"/v1/uploads/{upload_id}")).status_code == 404


async def test_a_bad_file_in_pieces_leaves_nothing(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    data = b"no film at all" * 100
    upload_id = (await _begin(client, person_id, data)).json()["id"]
    answer = await _send(client, upload_id, 0, data)
    assert answer.status_code == 422
    assert "'me.mp4' must be a video" in answer.json()["detail"]
    assert stored_files(services.settings) == []


async def test_uploads_of_others_stay_closed(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    upload_id = (await _begin(client, person_id, seeds.video())).json()["id"]
    other = bearer(services, account="neighbours")
    assert (await client.head(f"/v1/uploads/{upload_id}", headers=other)).status_code == 403
    assert (await client.delete(f"/v1/uploads/{upload_id}", headers=other)).status_code == 403


async def test_what_is_given_up_leaves_nothing(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    data = seeds.video()
    upload_id = (await _begin(client, person_id, data)).json()["id"]
    await _send(client, upload_id, 0, data[:1000])
    assert len(stored_files(services.settings)) == 1
    assert (await client.delete(f"/v1/uploads/{upload_id}")).status_code == 204
    assert stored_files(services.settings) == []
    assert (await client.head(f"/v1/uploads/{upload_id}")).status_code == 404
    assert (await _begin(client, person_id, data)).json()["offset"] == 0


async def test_a_last_piece_that_is_sent_again_empty_completes_the_upload(
    client: httpx.AsyncClient,
    services: Services,
    person_id: str,
    monkeypatch: pytest.MonkeyPatch,
):
    """As after a server that ended between the last piece and the sequence."""
    data = seeds.video()
    upload_id = (await _begin(client, person_id, data)).json()["id"]
    with monkeypatch.context() as ended:
        ended.setattr(uploads, "join", _power_cut)
        assert (await _send(client, upload_id, 0, data)).status_code == 500
    assert (await _begin(client, person_id, data)).json()["offset"] == len(data)
    last = await _send(client, upload_id, len(data), b"")
    assert (last.status_code, last.json()["state"]) == (202, "uploaded")


def _power_cut(*_: object) -> None:
    raise ConnectionError
