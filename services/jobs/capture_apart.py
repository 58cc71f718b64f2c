"""Captures a clip in a process of its own that has no secrets (`services.jobs.confined_capture`).

Decoders of video and pictures are C code. What a hostile clip makes of that process reaches the
clip, the landmark models and one folder, and no network; what it leaves in that folder is taken
over only where it is plain files.
"""

from __future__ import annotations

import json
import logging
import os
import shutil
import signal
import stat
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from capture.detection.network_files import landmark_network_file, optional_network_file
from capture.errors import CaptureStopped, UnreadableClip
from services.confinement import ConfinedProcess
from services.jobs.confined_capture import DRAFT, MEMORY_BYTES, PROCESSOR_S, RESULT
from services.jobs.kernel_cache import linked_kernels
from services.settings import Settings
from services.uploads.apart import refusal

log = logging.getLogger(__name__)

_LONGEST_TEXT = 2000
_TICK_S = 0.2
"""Between two looks at whether the capture is still wanted."""
_THREADS = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")
"""Of the environment: how many threads there are, and for what processor kernels are compiled."""


@dataclass(frozen=True)
class CaptureListener:
    """Who hears how far a capture is."""

    on_progress: Callable[[float, str], None]
    on_draft: Callable[[Path], None]
    """In a thread of its own, while the capture goes on; the folder is gone afterwards."""
    should_stop: Callable[[], bool]


def capture_apart(
    settings: Settings,
    source: Path,
    scratch: Path,
    person: str,
    height_m: float | None,
    listener: CaptureListener,
) -> Path:
    """As `capture.pipeline.capture_clip`; returns the folder of the sequence, in `scratch`.

    Raises also UnreadableClip where the process crashed, or left what is no sequence. Where it was
    killed, as happens when memory runs out, this process goes the same way.
    """
    folder = scratch / "confined"
    folder.mkdir()
    kernels = linked_kernels(folder / "kernels")
    wanted = {
        "source": str(source),
        "folder": str(folder),
        "person": person,
        "height_m": height_m,
        "networks": _networks(settings),
        "readable": [str(one) for one in kernels.behind],
    }
    environment = {name: os.environ[name] for name in _THREADS if name in os.environ}
    environment |= {"TMPDIR": str(folder), "HOME": str(folder)}
    environment["NUMBA_CACHE_DIR"] = str(kernels.folder)
    with (
        _Drafts(folder / DRAFT, scratch / DRAFT, listener.on_draft) as drafts,
        ConfinedProcess("services.jobs.confined_capture", **environment) as process,
    ):
        process.say(json.dumps(wanted).encode())
        end = _heard(process, drafts, listener)
        if end is None:
            raise _crashed(process)
    return _ended(end, folder, scratch / RESULT)


def _networks(settings: Settings) -> list[str | None]:
    """Files of pose, face and hand: fetched now, where they must be."""
    pose = landmark_network_file(settings.pose_model_source())
    others = (settings.face_model_source(), settings.hand_model_source())
    found = [pose, *map(optional_network_file, others)]
    return [None if one is None else str(one.resolve()) for one in found]


class _Drafts:
    """Looks at drafts while the capture goes on; at its end, waits for who looks."""

    def __init__(self, left: Path, taken: Path, on_draft: Callable[[Path], None]) -> None:
        self._left, self._taken, self._on_draft = left, taken, on_draft
        self._thread = ThreadPoolExecutor(1, "draft")
        self._looking: Future[None] | None = None

    def __enter__(self) -> _Drafts:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._thread.shutdown()
        if kind is None and self._looking is not None:
            self._looking.result()

    def take(self) -> None:
        """Take over the draft that was left, and begin to look; one is enough."""
        if self._looking is None:
            _take(self._left, self._taken)
            self._looking = self._thread.submit(self._look)

    def _look(self) -> None:
        self._on_draft(self._taken)
        shutil.rmtree(self._taken)


def _heard(
    process: ConfinedProcess, drafts: _Drafts, listener: CaptureListener
) -> Mapping[str, Any] | None:
    """The last that the process says; None where it ended without a word."""
    stopping = False
    for line in process.lines(_TICK_S):
        if listener.should_stop() and not stopping:
            stopping = True
            process.say(b"stop")
        match {} if line is None else _read(line):
            case {"progress": [float() | int() as share, str(message)]}:
                listener.on_progress(float(share), _plain(message))
            case {"draft": True}:
                drafts.take()
            case {"done": _} | {"stopped": _} | {"errno": int()} as end:
                return end
            case {"refused": str(), "error": str()} as end:
                return end
    return None


def _read(line: bytes) -> Any:
    try:
        return json.loads(line)
    except (ValueError, RecursionError) as error:
        raise UnreadableClip(
            "a clip must be captured; got what is no answer in its place; export it again"
        ) from error


def _plain(text: str) -> str:
    """Without what a database does not store, or a terminal obeys."""
    return "".join(one for one in text if one.isprintable())[:_LONGEST_TEXT]


def _ended(end: Mapping[str, Any], folder: Path, result: Path) -> Path:
    match end:
        case {"stopped": _}:
            raise CaptureStopped("the capture was stopped")
        case {"refused": str(why), "error": str(name)}:
            raise refusal(name)(_plain(why))
        case {"errno": int(number)}:
            raise OSError(number, os.strerror(number))
    _take(folder / RESULT, result)
    shutil.rmtree(folder)
    return result


def _take(made: Path, to: Path) -> None:
    """Move a folder to where the process cannot reach it. Raises UnreadableClip for one that leads
    elsewhere."""
    with suppress(OSError):
        made.rename(to)
    if to.is_symlink() or not to.is_dir():
        raise UnreadableClip("a capture must leave a sequence; got none")
    for at, folders, files in os.walk(to):
        for name in (*folders, *files):
            about = Path(at, name).lstat()
            file = stat.S_ISREG(about.st_mode) and about.st_nlink == 1
            if not (file or stat.S_ISDIR(about.st_mode)):
                raise UnreadableClip(f"a sequence must be plain files; got {name!r}")


def _crashed(process: ConfinedProcess) -> Exception:
    code, how = process.wait(), process.how_ended()
    if code == -signal.SIGKILL:
        log.warning("the process that captures was killed")
        os.kill(os.getpid(), signal.SIGKILL)
    if code < 0 or "MemoryError" in how:
        return UnreadableClip(
            f"a clip must be captured within {PROCESSOR_S // 3600} hours of processor time and "
            f"{MEMORY_BYTES >> 30} GB; got {how}; export it again, shorter or smaller"
        )
    return RuntimeError(f"the process that captures failed: {how}")
