"""Uploads in pieces over a line that breaks, against a service that keeps what has come."""

from __future__ import annotations

import hashlib
import json

import httpx
import pytest

from capture.errors import CaptureStopped, UploadFailed
from capture.upload import PIECE_BYTES, upload


class Service:
    """The upload routes, in memory; `breaks` lists after which requests the line is cut."""

    def __init__(self, breaks: tuple[int, ...] = (), refuse: str | None = None) -> None:
        self.data, self.size, self.sha256 = b"", 0, ""
        self.people: list[dict] = []
        self.requests, self._breaks, self._refuse = 0, breaks, refuse

    def __call__(self, request: httpx.Request) -> httpx.Response:
        self.requests += 1
        path = request.url.path
        if path == "/v1/guest":
            return httpx.Response(201, json={"token": "t"})
        if path == "/v1/people" and request.method == "GET":
            return httpx.Response(200, json={"items": self.people})
        if path == "/v1/people":
            self.people.append({"id": "p1", **json.loads(request.content)})
            return httpx.Response(201, json=self.people[-1])
        if path == "/v1/people/p1" and request.method == "DELETE":
            self.people.clear()
            return httpx.Response(200, json={})
        if path == "/v1/people/p1/uploads":
            about = json.loads(request.content)
            if about["sha256"] == self.sha256 and len(self.data) == about["size"]:
                return httpx.Response(200, json={"sequence": {"id": "s1", "state": "ready"}})
            self.size, self.sha256 = about["size"], about["sha256"]
            return httpx.Response(201, json={"id": "u1", "offset": len(self.data)})
        if request.method == "HEAD":
            return httpx.Response(200, headers={"Upload-Offset": str(len(self.data))})
        if self._refuse:
            problem = {"title": "Invalid input", "detail": self._refuse}
            return httpx.Response(422, json=problem)
        if int(request.headers["Upload-Offset"]) != len(self.data):
            return httpx.Response(409, json={"title": "Conflict", "detail": "wrong offset"})
        cut = self.requests in self._breaks
        self.data += request.content[: len(request.content) // 2] if cut else request.content
        if cut:
            raise httpx.ReadError("cut", request=request)
        if len(self.data) == self.size:
            assert hashlib.sha256(self.data).hexdigest() == self.sha256
            return httpx.Response(202, json={"id": "s1", "state": "uploaded"})
        return httpx.Response(204, headers={"Upload-Offset": str(len(self.data))})


@pytest.fixture
def clip(tmp_path):
    path = tmp_path / "clip.mp4"
    path.write_bytes(bytes(range(256)) * (3 * PIECE_BYTES // 256 + 5))
    return path


def send(service: Service, source, **options):
    transport = httpx.MockTransport(service)
    return upload(
        source, "http://service", "Ada", transport=transport, sleep=lambda _: None, **options
    )


def test_all_bytes_arrive_and_progress_is_told(clip):
    service, told = Service(), []
    sequence = send(service, clip, on_progress=lambda done, message: told.append(done))
    assert sequence["id"] == "s1"
    assert service.data == clip.read_bytes()
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_a_cut_line_goes_on_where_the_service_is(clip):
    service = Service(breaks=(5, 8))
    send(service, clip)
    assert service.data == clip.read_bytes()


def test_a_stopped_upload_goes_on_later(clip):
    service, stops = Service(), iter([False, False, True])
    with pytest.raises(CaptureStopped, match="stopped at 2097152 of"):
        send(service, clip, should_stop=lambda: next(stops))
    before = service.requests
    send(service, clip)
    assert service.data == clip.read_bytes()
    assert service.requests - before < 7


def test_the_same_bytes_are_not_sent_again(clip):
    service = Service()
    send(service, clip)
    before = service.requests
    assert send(service, clip)["state"] == "ready"
    assert service.requests == before + 3


def test_a_refusal_is_told_in_the_services_words(clip):
    with pytest.raises(UploadFailed, match=r"Invalid input \(422\): a clip must be a video"):
        send(Service(refuse="a clip must be a video"), clip)


@pytest.mark.parametrize("there_before", [False, True])
def test_a_person_made_for_a_refused_clip_goes_with_it(clip, there_before):
    service = Service(refuse="a clip must be a video")
    service.people = [{"id": "p1", "name": "Ada"}] if there_before else []
    with pytest.raises(UploadFailed):
        send(service, clip)
    assert bool(service.people) is there_before


def test_a_height_is_told_as_a_person_is_made_and_may_be_told_again(clip):
    service = Service()
    send(service, clip, height_m=1.78)
    assert service.people == [{"id": "p1", "name": "Ada", "height_m": 1.78}]
    assert send(service, clip, height_m=1.78)["state"] == "ready"
    assert send(service, clip)["state"] == "ready"


@pytest.mark.parametrize(("known", "told"), [(1.7, "is 1.7 m"), (None, "is not known")])
def test_another_height_than_a_person_has_is_refused_before_anything_is_sent(clip, known, told):
    service = Service()
    service.people = [{"id": "p1", "name": "Ada", "height_m": known}]
    with pytest.raises(UploadFailed, match=f"got 1.78 for Ada, whose height {told}"):
        send(service, clip, height_m=1.78)
    assert service.data == b""
    assert service.people


def test_a_dead_service_is_named(clip):
    def dead(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("refused", request=request)

    with pytest.raises(UploadFailed, match="must be the address of a running service; got no"):
        upload(clip, "http://service", "Ada", transport=httpx.MockTransport(dead))


def test_a_folder_of_frames_travels_as_the_same_zip_every_time(tmp_path):
    (tmp_path / "seq" / "images").mkdir(parents=True)
    for name in ("1.png", "0.png"):
        (tmp_path / "seq" / "images" / name).write_bytes(name.encode())
    first, second = Service(), Service()
    send(first, tmp_path / "seq")
    send(second, tmp_path / "seq")
    assert first.data == second.data
    assert first.data[:2] == b"PK"
