"""The model's file: by path, by address, and never a wrong one."""

from __future__ import annotations

import hashlib
import socket
import threading
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from capture.detection.landmarks import MediaPipeEstimator
from capture.detection.network_files import (
    FACE_MODEL,
    HAND_MODEL,
    POSE_MODEL,
    LandmarkNetwork,
    NetworkSource,
    landmark_network_file,
    require_given,
)
from capture.errors import PoseModelMissing
from tests.landmark_models import silent_server
from tests.shared_data import shared_data

BODY = b"a model" * 1000
SHA256 = hashlib.sha256(BODY).hexdigest()


def at(url: str, folder: Path, model: LandmarkNetwork = POSE_MODEL) -> NetworkSource:
    """A source whose maker publishes BODY at `url`."""
    return NetworkSource(
        folder=folder, model=replace(model, url=url, known_sha256={SHA256: "a test's"})
    )


@pytest.fixture
def server():
    """Serves BODY at /model.task, a cut one at /cut.task, and counts the calls."""
    calls: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            calls.append(self.path)
            if self.path == "/gone.task":
                self.send_error(404)
                return
            self.send_response(200)
            self.send_header("Content-Length", str(len(BODY)))
            self.end_headers()
            self.wfile.write(BODY if self.path == "/model.task" else BODY[:100])

        def log_message(self, format, *args):
            pass

    running = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=running.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{running.server_port}", calls
    running.shutdown()
    thread.join()
    running.server_close()


def test_it_is_fetched_once_and_checked(server, tmp_path):
    address, calls = server
    source = at(f"{address}/model.task", tmp_path)
    assert landmark_network_file(source).read_bytes() == BODY
    assert landmark_network_file(source) == tmp_path / "model.task"
    assert calls == ["/model.task"]


def test_an_unknown_file_is_refused_with_its_hash_and_leaves_nothing(server, tmp_path):
    address, _ = server
    source = NetworkSource(folder=tmp_path, model=replace(POSE_MODEL, url=f"{address}/model.task"))
    with pytest.raises(PoseModelMissing, match=f"got {SHA256}.*set METANERF_POSE_MODEL to its"):
        landmark_network_file(source)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["cut.task", "gone.task"])
def test_a_cut_or_missing_download_leaves_nothing(server, tmp_path, name):
    address, _ = server
    source = at(f"{address}/{name}", tmp_path)
    with pytest.raises(PoseModelMissing):
        landmark_network_file(source)
    assert list(tmp_path.iterdir()) == []


def test_a_spoilt_copy_is_fetched_again(server, tmp_path):
    address, _ = server
    (tmp_path / "model.task").write_bytes(b"spoilt")
    source = at(f"{address}/model.task", tmp_path)
    assert landmark_network_file(source).read_bytes() == BODY


def test_no_network_says_what_to_do(tmp_path):
    source = at("http://127.0.0.1:9/model.task", tmp_path)
    with pytest.raises(PoseModelMissing, match="set METANERF_POSE_MODEL to the file"):
        landmark_network_file(source)


@pytest.mark.parametrize("model", [FACE_MODEL, HAND_MODEL])
def test_nobody_waits_long_for_a_model_that_captures_do_without(tmp_path, model):
    assert model.timeout_s <= 5.0
    impatient = replace(model, timeout_s=0.2)
    with silent_server() as address:
        source = at(f"{address}/model.task", tmp_path, impatient)
        with pytest.raises(PoseModelMissing, match=f"{model.name} model must be fetched .* timed"):
            landmark_network_file(source)
    assert list(tmp_path.iterdir()) == []


def test_a_server_of_something_else_is_told(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def greet():
            caller, _ = listening.accept()
            with caller:
                caller.recv(1024)
                caller.sendall(b"220 mail.example ready\r\n")

        thread = threading.Thread(target=greet)
        thread.start()
        address = f"http://127.0.0.1:{listening.getsockname()[1]}/model.task"
        with pytest.raises(PoseModelMissing, match=r"fetched once .* 220 mail"):
            landmark_network_file(at(address, tmp_path))
        thread.join()
    assert list(tmp_path.iterdir()) == []


def test_only_a_path_that_was_given_must_be_there(tmp_path):
    to_fetch = at("http://127.0.0.1:9/model.task", tmp_path)
    own = tmp_path / "own.task"
    own.write_bytes(BODY)
    require_given(to_fetch, None, own)
    with pytest.raises(PoseModelMissing, match=r"hand model .*; set METANERF_HAND_MODEL to a hand"):
        require_given(own, own, tmp_path / "absent.task")


def test_messages_tell_of_the_model_that_is_meant(tmp_path):
    absent = NetworkSource(tmp_path / "absent.task", model=FACE_MODEL)
    with pytest.raises(PoseModelMissing, match=r"face model .* METANERF_FACE_MODEL to a face_land"):
        landmark_network_file(absent)


def test_a_path_is_used_as_it_is(tmp_path):
    path = tmp_path / "own.task"
    path.write_bytes(BODY)
    assert landmark_network_file(path) == path
    assert landmark_network_file(NetworkSource(path)) == path
    with pytest.raises(PoseModelMissing, match=r"must be a file; got .*absent"):
        landmark_network_file(tmp_path / "absent.task")


def test_the_tests_own_model_is_among_the_known():
    path = shared_data("models/pose_landmarker_full.task")
    assert hashlib.sha256(path.read_bytes()).hexdigest() in POSE_MODEL.known_sha256


def test_a_file_that_is_no_model_is_refused(tmp_path):
    path = tmp_path / "own.task"
    path.write_bytes(BODY)
    with pytest.raises(PoseModelMissing, match=r"must be a MediaPipe \.task file"):
        MediaPipeEstimator(path)
