"""A capture's confined process: what it says is heard, what it leaves is looked at, and no more."""

from __future__ import annotations

import errno
import multiprocessing
import signal
import threading
from pathlib import Path

import pytest

from capture.errors import CaptureStopped, NoPersonFound, UnreadableClip
from services.jobs.capture_apart import CaptureListener, capture_apart
from services.jobs.kernel_cache import linked_kernels
from services.jobs.report import JobStopped
from services.settings import Settings
from tests.services import seeds
from tests.services.conftest import Instead, changed


@pytest.fixture
def given(settings: Settings, tmp_path: Path) -> Settings:
    """Settings with networks that nobody fetches."""
    network = tmp_path / "network.task"
    network.write_bytes(b"a network")
    names = ("pose_model", "face_model", "hand_model")
    return changed(settings, **dict.fromkeys(names, network))


@pytest.fixture
def scratch(tmp_path: Path) -> Path:
    folder = tmp_path / "scratch"
    folder.mkdir()
    (folder / "source.mp4").write_bytes(b"a clip")
    return folder


@pytest.fixture
def instead(instead: Instead) -> Instead:
    """In the capture's folder, once it was told what is wanted."""
    return lambda script: instead(f'read wanted\ncd "$TMPDIR"\n{script}')


class Heard:
    """What a capture says."""

    def __init__(self, stop: bool = False) -> None:
        self.progress: list[tuple[float, str]] = []
        self.drafts: list[Path] = []
        self.stop = stop

    def listener(self) -> CaptureListener:
        return CaptureListener(
            lambda share, message: self.progress.append((share, message)),
            self.drafts.append,
            lambda: self.stop,
        )


def captured(settings: Settings, scratch: Path, heard: Heard | None = None) -> Path:
    source = scratch / "source.mp4"
    return capture_apart(settings, source, scratch, "Ada", 1.8, (heard or Heard()).listener())


def test_progress_and_a_draft_are_heard_and_the_sequence_is_taken(
    given: Settings, scratch: Path, instead: Instead
):
    heard = Heard()
    instead("""
    mkdir draft && echo of-the-draft > draft/file
    echo '{"progress": [0.5, "fitting"]}'
    echo '{"draft": true}'
    mkdir sequence && echo "$wanted" > sequence/file
    echo '{"done": true}'
    """)
    out = captured(given, scratch, heard)
    assert heard.progress == [(0.5, "fitting")]
    assert heard.drafts == [scratch / "draft"]
    assert '"person": "Ada", "height_m": 1.8' in (out / "file").read_text()
    assert sorted(one.name for one in scratch.iterdir()) == ["sequence", "source.mp4"]


def test_a_capture_goes_on_while_its_draft_is_looked_at_and_waits_for_that_at_its_end(
    given: Settings, scratch: Path, instead: Instead
):
    further, looked_at = threading.Event(), list[str]()

    def look(draft: Path) -> None:
        assert further.wait(10.0)
        looked_at.append((draft / "file").read_text().strip())

    listener = CaptureListener(
        lambda share, _: further.set() if share > 0.6 else None, look, lambda: False
    )
    instead("""
    mkdir draft && echo of-the-draft > draft/file
    echo '{"draft": true}'
    while test -e draft; do sleep 0.01; done
    echo '{"progress": [0.7, "fitting"]}'
    mkdir sequence
    echo '{"done": true}'
    """)
    capture_apart(given, scratch / "source.mp4", scratch, "Ada", None, listener)
    assert looked_at == ["of-the-draft"]
    assert sorted(one.name for one in scratch.iterdir()) == ["sequence", "source.mp4"]


def test_what_befalls_whoever_looks_at_a_draft_ends_the_capture(
    given: Settings, scratch: Path, instead: Instead
):
    def look(_: Path) -> None:
        raise JobStopped

    instead("""
    mkdir draft && echo '{"draft": true}'
    while test -e draft; do sleep 0.01; done
    mkdir sequence && echo '{"done": true}'
    """)
    listener = CaptureListener(lambda *_: None, look, lambda: False)
    with pytest.raises(JobStopped):
        capture_apart(given, scratch / "source.mp4", scratch, "Ada", None, listener)


@pytest.mark.parametrize(
    "script",
    [
        "ln -s /etc sequence",
        "mkdir sequence; ln -s /etc/passwd sequence/motion.npz",
        "mkdir -p sequence/a; ln -s /etc sequence/a/images",
        "mkdir sequence; ln ../source.mp4 sequence/motion.npz",
        "mkdir sequence; mkfifo sequence/motion.npz",
        "echo > sequence",
        "true",
    ],
)
def test_what_leads_elsewhere_is_not_taken(
    given: Settings, scratch: Path, instead: Instead, script: str
):
    instead(f"{script}\necho '{{\"done\": true}}'")
    with pytest.raises(UnreadableClip, match=r"plain files; got|a sequence; got none"):
        captured(given, scratch)


@pytest.mark.parametrize(
    ("said", "error", "told"),
    [
        ('{"refused": "nobody", "error": "NoPersonFound"}', NoPersonFound, "nobody"),
        ('{"refused": "so", "error": "SystemExit"}', UnreadableClip, "so"),
        ('{"stopped": true}', CaptureStopped, "stopped"),
        (f'{{"errno": {errno.ENOSPC}}}', OSError, "No space left"),
        ("no json", UnreadableClip, "must be captured; got"),
        ('{"refused": "a\\u0000b\\u001b[2J", "error": "NoPersonFound"}', NoPersonFound, "ab"),
        ("[" * 70_000, UnreadableClip, "must be captured; got"),
    ],
)
def test_an_end_comes_through(
    given: Settings,
    scratch: Path,
    instead: Instead,
    said: str,
    error: type[Exception],
    told: str,
):
    instead(f"echo '{said}'")
    with pytest.raises(error, match=told):
        captured(given, scratch)


@pytest.mark.parametrize(
    ("script", "error", "told"),
    [
        ("kill -SEGV $$", UnreadableClip, "16 GB; got SIGSEGV; export it again"),
        ("kill -XCPU $$", UnreadableClip, "4 hours of processor time .*; got SIGXCPU"),
        ("echo MemoryError >&2; exit 1", UnreadableClip, "got MemoryError"),
        ("echo 'KeyError: 1' >&2; exit 1", RuntimeError, "failed: KeyError: 1"),
        ("exit 0", RuntimeError, "failed: exit code 0"),
    ],
)
def test_a_crash_is_told(
    given: Settings,
    scratch: Path,
    instead: Instead,
    script: str,
    error: type[Exception],
    told: str,
):
    instead(script)
    with pytest.raises(error, match=told):
        captured(given, scratch)


def test_whoever_wants_it_no_longer_has_it_stopped(
    given: Settings, scratch: Path, instead: Instead
):
    instead("""read answer; test "$answer" = stop && echo '{"stopped": true}'""")
    with pytest.raises(CaptureStopped):
        captured(given, scratch, Heard(stop=True))


def test_one_that_was_killed_takes_its_job_along(given: Settings, scratch: Path, instead: Instead):
    """So that it is tried again, as any job whose process was killed for its memory."""
    instead("kill -KILL $$")
    job = multiprocessing.get_context("fork").Process(target=captured, args=(given, scratch))
    job.start()
    job.join(60)
    assert job.exitcode == -signal.SIGKILL


def test_kernels_are_linked_to_and_never_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    ours = tmp_path / "ours" / "fitting_0123"
    ours.mkdir(parents=True)
    (ours / "kernel.nbi").write_bytes(b"index")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "ours"))
    kernels = linked_kernels(tmp_path / "theirs")
    link = kernels.folder / "fitting_0123" / "kernel.nbi"
    assert link.is_symlink()
    assert link.read_bytes() == b"index"
    link.unlink()
    link.write_bytes(b"another")
    assert (ours / "kernel.nbi").read_bytes() == b"index"
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    assert linked_kernels(tmp_path / "again").behind != kernels.behind


def test_a_clip_without_anybody_is_refused_in_its_own_words(
    settings: Settings, scratch: Path, pose_model: Path
):
    (scratch / "source.mp4").write_bytes(seeds.video(4, 64))
    heard = Heard()
    with pytest.raises((NoPersonFound, UnreadableClip), match="must"):
        captured(changed(settings, pose_model=pose_model), scratch, heard)
    assert heard.progress
