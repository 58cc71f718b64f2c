"""A hostile file can take nothing along but the process that looks at it."""

from __future__ import annotations

import errno
import os
import resource
import struct
import subprocess
import sys
import tempfile
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path

import cv2
import httpx
import numpy as np
import pytest

import capture.errors
from capture.errors import UnreadableClip
from db.models import SequenceKind
from scene.errors import SceneError
from services.settings import Settings
from services.uploads.apart import check_upload_apart, read_panorama_apart
from tests.services import seeds
from tests.services.conftest import serving, stored_files


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    path = tmp_path / "clip.zip"
    path.write_bytes(seeds.real_frames())
    return path


def confined(code: str) -> subprocess.CompletedProcess[str]:
    """What a confined process does."""
    begun = "from services.uploads.confined import confine_for; confine_for(0)\n"
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        return subprocess.run(
            [sys.executable, "-c", begun + code],
            capture_output=True,
            text=True,
            check=False,
            env=environment | {"TMPDIR": folder},
        )


def test_frames_are_found_to_be_frames(clip: Path):
    assert check_upload_apart(clip, "clip.zip").kind is SequenceKind.FRAMES


def test_a_refusal_comes_through_as_it_was_said(tmp_path: Path):
    path = tmp_path / "empty.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "nothing")
    with pytest.raises(UnreadableClip, match="must hold"):
        check_upload_apart(path, "empty.zip")


@pytest.mark.parametrize(
    ("script", "told"),
    [
        ("kill -SEGV $$", "SIGSEGV"),
        ("echo 'MemoryError' >&2; exit 1", "MemoryError"),
        ("kill -XCPU $$", "SIGXCPU"),
    ],
)
def test_a_crash_is_told_and_harms_nobody(instead, clip: Path, script: str, told: str):
    instead(script)
    with pytest.raises(UnreadableClip, match=f"got {told} while it was looked at; export it again"):
        check_upload_apart(clip, "clip.zip")


@pytest.mark.parametrize(
    ("script", "told"),
    [
        # both for ever
        ("while :; do echo words; done", "more than there is to say"),
        ("while :; do echo words >&2; done", "no end after 1 s"),
        # somebody else holds its pipes, and goes on
        ("sleep 30 & exit 0", "no end after 1 s"),
        ("sleep 30 >&2 & echo nothing", "an answer that is none"),
        ("echo '[]'", "an answer that is none"),
        ("""echo '{"kind": "film"}'""", "an answer that is none"),
        ("""echo '{"errno": []}'""", "an answer that is none"),
    ],
)
def test_whatever_it_prints_is_bounded_and_ends(
    instead, clip: Path, monkeypatch: pytest.MonkeyPatch, script: str, told: str
):
    monkeypatch.setattr("services.uploads.apart.LOOK_S", 1.0)
    instead(script)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(UnreadableClip, match=f"got {told} while it was looked at"):
        check_upload_apart(clip, "clip.zip")
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 20_000, f"{grown} KiB"


def test_the_last_words_of_a_crash_are_kept_and_no_more(instead, clip: Path):
    instead("yes words | head -c 9000000 >&2; echo 'the last' >&2; exit 1")
    with pytest.raises(UnreadableClip, match="got the last while"):
        check_upload_apart(clip, "clip.zip")


def test_a_full_disk_is_no_fault_of_the_clip(instead, clip: Path):
    instead(f"""echo '{{"errno": {errno.ENOSPC}}}'""")
    with pytest.raises(OSError, match="No space left") as full:
        check_upload_apart(clip, "clip.zip")
    assert full.value.errno == errno.ENOSPC


def test_no_secret_is_told(instead, clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("METANERF_JWT_SECRET", "of the server")
    instead(f"""env > {tmp_path / "told"}; echo '{{"kind": "frames"}}'""")
    check_upload_apart(clip, "clip.zip")
    told = (tmp_path / "told").read_text()
    assert "PATH=" in told
    assert "of the server" not in told


def test_memory_files_and_time_are_bounded():
    assert "MemoryError" in confined("bytearray(4 << 30)").stderr
    assert (
        "File too large"
        in confined(
            "import tempfile\nwith tempfile.TemporaryFile() as file:\n    file.truncate(65 << 20)"
        ).stderr
    )
    assert (
        "Too many open files" in confined("files = [open('/dev/null') for _ in range(99)]").stderr
    )
    asked = confined("import resource; print(resource.getrlimit(resource.RLIMIT_CPU))")
    assert asked.stdout == "(60, 60)\n"


def test_where_memory_runs_out_it_goes_before_the_server():
    assert confined("print(open('/proc/self/oom_score_adj').read())").stdout.strip() == "1000"


@pytest.mark.parametrize("family", ["AF_INET", "AF_INET6", "AF_UNIX"])
def test_there_is_no_network_but_files_can_be_made(family: str):
    code = (
        "import socket, tempfile\n"
        "tempfile.NamedTemporaryFile()\n"
        f"socket.socket(socket.{family}, socket.SOCK_DGRAM)"
    )
    assert "PermissionError" in confined(code).stderr.splitlines()[-1]


def test_what_was_open_before_has_no_network_where_root_leaves_it():
    if os.geteuid() != 0:
        pytest.skip("not root: the system may not let a process leave its network")
    assert "[]" in confined("print(open('/proc/self/net/route').read().splitlines()[1:])").stdout


NO_LANDLOCK = "this kernel has no Landlock"


def has_landlock() -> bool:
    forked = confined("print(open('/proc/sys/kernel/ostype').read())")
    return "Permission denied" in forked.stderr


@pytest.mark.skipif(not has_landlock(), reason=NO_LANDLOCK)
def test_no_files_are_reached_but_those_it_needs(tmp_path: Path):
    secret, package = tmp_path / "secret", Path(capture.errors.__file__).parent
    secret.write_text("of the server")
    for attempt in (
        f"print(open({str(secret)!r}).read())",
        f"import os; print(os.listdir({str(tmp_path)!r}))",
        "print(open(f'/proc/{os.getppid()}/environ').read())",
        f"open({str(package / 'errors.py')!r}, 'a')",
        f"open({str(package / 'planted.py')!r}, 'w')",
        f"import os; os.symlink({str(secret)!r}, {str(package / 'link')!r})",
        f"os.kill({os.getpid()}, 0)",
        "import socket; socket.create_server(('127.0.0.1', 0))",
    ):
        done = confined(f"import os\n{attempt}")
        assert "PermissionError" in done.stderr, attempt
        assert "of the server" not in done.stdout
    assert "CaptureError" in confined(f"print(open({str(package / 'errors.py')!r}).read())").stdout


def test_an_upload_that_crashes_its_reader_is_refused_and_leaves_nothing(
    instead, settings: Settings
):
    with serving(settings) as caller:
        person_id = caller.post("/v1/people", json={"name": "Ada"}).json()["id"]
        instead("kill -SEGV $$")
        answer = upload(caller, person_id)
        assert (answer.status_code, answer.json()["type"]) == (422, "urn:metanerf:invalid-input")
        assert "SIGSEGV" in answer.json()["detail"]
        assert stored_files(settings) == []


def upload(caller: httpx.Client, person_id: str) -> httpx.Response:
    files = {"file": ("frames.zip", seeds.real_frames())}
    return caller.post(f"/v1/people/{person_id}/sequences", files=files)


def png(width: int, height: int, pixels: bytes) -> bytes:
    """A picture of grey whose rows are `pixels`, whatever the header says."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        checked = kind + data
        return struct.pack(">I", len(data)) + checked + struct.pack(">I", zlib.crc32(checked))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    data = zlib.compress(pixels, 9)
    parts = (chunk(b"IHDR", header), chunk(b"IDAT", data), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def panorama() -> np.ndarray:
    return np.full((32, 64, 3), 90, np.uint8)


def test_a_panoramas_pixels_come_as_they_are_and_no_wider_than_wanted():
    picture = cv2.imencode(".png", panorama())[1].tobytes()
    assert np.array_equal(read_panorama_apart(picture, 64), panorama())
    assert read_panorama_apart(picture, 32).shape == (16, 32, 3)


def test_pictures_that_are_bombs_cost_the_server_nothing():
    # one says it has a gigapixel, one has as many as are taken, and of one the bytes go on
    declared = png(60_000, 30_000, bytes(6_000_000))
    square = png(8192, 8192, bytes(8192 * 8193))
    endless = png(64, 32, bytes(1 << 26))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for picture, said in ((declared, "picture"), (square, "as wide as high")):
        assert len(picture) < 300_000
        with pytest.raises(SceneError, match=said):
            read_panorama_apart(picture, 2048)
    assert len(endless) < 300_000
    assert read_panorama_apart(endless, 2048).shape == (32, 64, 3)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 20_000, f"{grown} KiB"


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_cut_pictures_are_refused_or_taken_and_crash_nobody(suffix: str):
    noise = np.random.default_rng(1).integers(0, 256, (32, 64, 3), np.uint8)
    picture = cv2.imencode(suffix, noise)[1].tobytes()
    for length in (3, 20, len(picture) // 2, len(picture) - 1):
        with suppress(UnreadableClip):
            assert read_panorama_apart(picture[:length], 64).shape == (32, 64, 3)


@pytest.mark.parametrize(
    ("script", "told"),
    [
        ("kill -SEGV $$", "a panorama must be read within .* got SIGSEGV"),
        ("""echo '{"shape": [32, 64, 3]}'; echo few""", "twice as wide"),
        ("""echo '{"shape": [32, 6400, 3]}'""", "twice as wide"),
        ("""echo '{"refused": "no", "error": "SystemExit"}'""", "no"),
    ],
)
def test_whoever_takes_the_process_over_says_no_more_than_pixels(instead, script: str, told: str):
    instead(script)
    with pytest.raises(UnreadableClip, match=told):
        read_panorama_apart(b"", 2048)


def test_a_gateway_decodes_no_panorama_itself(settings: Settings, instead):
    with serving(settings) as caller:
        meeting_id = caller.post("/v1/meetings", json={"name": "Monday"}).json()["id"]
        instead("kill -SEGV $$")
        picture = cv2.imencode(".png", panorama())[1].tobytes()
        answer = caller.put(f"/v1/meetings/{meeting_id}/panorama", content=picture)
        assert (answer.status_code, answer.json()["type"]) == (422, "urn:metanerf:invalid-input")
        assert caller.get(f"/v1/meetings/{meeting_id}").json()["environment"] == "studio"
