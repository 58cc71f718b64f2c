"""How a process gives up what it does not need before it reads a stranger's file.

Decoders of video and pictures are C code, and a hostile file may crash them, fill the memory, never
end, or run its own code. So they run in processes of their own, with bounded memory, time and
files, no sockets, no network where the system lets a process give it up, and nothing secret in the
environment.
"""

from __future__ import annotations

import ctypes
import os
import resource
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, Self

from services.landlock import restrict_files
from services.seccomp import refuse_sockets

_PASSED_ON = ("PATH", "TMPDIR", "LANG", "LD_LIBRARY_PATH")
"""Of the environment, whose other variables may be secret."""
_SYSTEM = tuple(
    map(
        Path,
        (
            *("/usr", "/lib", "/lib64", "/sys/devices/system"),
            *("/etc/ld.so.cache", "/etc/localtime", "/dev/urandom", "/dev/random"),
            *("/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/proc/stat"),
        ),
    )
)
"""What libraries read."""
_DEVICES = (Path("/dev/null"),)
_PACKAGES = ("scene", "capture", "services", "db")
_NEW_USER, _NEW_NETWORK = 0x10000000, 0x40000000
"""CLONE_NEWUSER and CLONE_NEWNET of unshare(2)."""


_LAST_WORDS_BYTES = 16 << 10
"""Kept of what a process prints as errors."""
_LONGEST_WORDS = 200
"""Characters of a line of that which are told."""
_LAST_WORDS_S = 2.0
_PIECE_BYTES = _LONGEST_LINE_BYTES = 64 << 10


class Limits(NamedTuple):
    """What a process may take at most."""

    memory_bytes: int
    """Of addresses."""
    processor_s: int
    file_bytes: int
    open_files: int


def confine(limits: Limits, readable: Sequence[Path] = (), writable: Sequence[Path] = ()) -> None:
    """Limit this process for good; before it has threads.

    Beside Python, the system's libraries and this package, it reaches only `readable` and
    `writable` from then on, where the system can hold it to that.
    """
    _be_the_first_to_go()
    _leave_network()
    ours = Path(__file__).parents[1]
    restrict_files(
        [*_SYSTEM, Path(sys.prefix), Path(sys.base_prefix), *(ours / one for one in _PACKAGES)]
        + [Path(one) for one in sys.path if one and Path(one).name == "site-packages"]
        + list(readable),
        [*_DEVICES, *writable],
        [Path(one) for one in sys.path if one],
    )
    refuse_sockets()
    for kind, limit in (
        (resource.RLIMIT_AS, limits.memory_bytes),
        (resource.RLIMIT_CPU, limits.processor_s),
        (resource.RLIMIT_FSIZE, limits.file_bytes),
        (resource.RLIMIT_NOFILE, limits.open_files),
        (resource.RLIMIT_CORE, 0),
    ):
        _, most = resource.getrlimit(kind)
        limit = limit if most == resource.RLIM_INFINITY else min(limit, most)
        with suppress(ValueError, OSError):  # macOS takes no limit of addresses
            resource.setrlimit(kind, (limit, limit))


def outcome(work: Callable[[], dict[str, object]]) -> dict[str, object]:
    """What `work` returns, for whoever waits for this process; `refused` and `error` where it
    refuses what it was given, `errno` where the disk is full."""
    from db.objects import no_space
    from scene.errors import SceneError

    try:
        return work()
    except SceneError as error:
        return {"refused": str(error), "error": type(error).__name__}
    except OSError as error:
        if not no_space(error):
            raise
        return {"errno": error.errno}


def bare_environment() -> dict[str, str]:
    """The environment of a confined process: how to start Python, and nothing else."""
    passed_on = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    return passed_on | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


class ConfinedProcess:
    """A Python module in a process that confines itself, and what it says.

    Use as a context manager: the process is gone afterwards. What it prints is kept within bounds,
    as it may print for ever.
    """

    def __init__(self, module: str, *arguments: str, **environment: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            env=bare_environment() | environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,  # closing a pipe waits for no writer
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self.input, self.output = self._process.stdin, self._process.stdout
        self._last_words = bytearray()
        # it would stand still if nobody read
        self._listening = threading.Thread(target=self._listen, daemon=True)
        self._listening.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.kill()
        self._process.wait()
        for pipe in (self.input, self.output):
            with suppress(OSError):  # what was not read to its end
                pipe.close()
        # what it left behind may hold the pipes open
        self._listening.join(_LAST_WORDS_S)

    def kill(self) -> None:
        """Have it end now, whatever it does."""
        self._process.kill()

    def say(self, line: bytes) -> None:
        """Give it a line. Nothing happens where it has ended."""
        with suppress(OSError):
            self.input.write(line + b"\n")

    def lines(self, tick_s: float) -> Iterator[bytes | None]:
        """The lines that it prints until its end; None whenever none came for `tick_s`.

        One that is longer than any it has to say is cut.
        """
        ready = select.poll()
        ready.register(self.output.fileno(), select.POLLIN)
        begun = b""
        while True:
            if not ready.poll(1e3 * tick_s):
                yield None
                continue
            if not (piece := os.read(self.output.fileno(), _PIECE_BYTES)):
                return
            *whole, begun = (begun + piece).split(b"\n")
            yield from whole
            if len(begun) > _LONGEST_LINE_BYTES:
                yield begun
                begun = b""

    def feed(self, data: bytes) -> None:
        """Give it all of `data`, then the end, while it says what it does."""
        threading.Thread(target=self._feed, args=(data,), daemon=True).start()

    def give(self, data: bytes, timeout_s: float) -> None:
        """Have it take all of `data`.

        Raises TimeoutError where it does not in time, BrokenPipeError where it has ended.
        """
        left, end_s = memoryview(data), time.monotonic() + timeout_s
        pipe = self.input.fileno()
        os.set_blocking(pipe, False)
        ready = select.poll()
        ready.register(pipe, select.POLLOUT)
        while left:
            _require_answer(ready, end_s, timeout_s)
            left = left[os.write(pipe, left) :]

    def take(self, count: int, timeout_s: float) -> bytes:
        """The next `count` bytes that it prints; fewer where it ends before.

        Raises TimeoutError where that takes longer.
        """
        said, end_s = bytearray(), time.monotonic() + timeout_s
        pipe = self.output.fileno()
        ready = select.poll()
        ready.register(pipe, select.POLLIN)
        while len(said) < count:
            _require_answer(ready, end_s, timeout_s)
            if not (piece := os.read(pipe, min(_PIECE_BYTES, count - len(said)))):
                break
            said += piece
        return bytes(said)

    def take_into(self, room: memoryview, timeout_s: float) -> int:
        """Fill `room`, of bytes, with the next that it prints, which are copied nowhere else; how
        many, fewer than there is room for where it ends before.

        Raises TimeoutError where that takes longer.
        """
        taken, end_s = 0, time.monotonic() + timeout_s
        pipe = self.output.fileno()
        ready = select.poll()
        ready.register(pipe, select.POLLIN)
        while taken < len(room):
            _require_answer(ready, end_s, timeout_s)
            if not (count := os.readv(pipe, [room[taken:]])):
                break
            taken += count
        return taken

    def read(self, most_bytes: int, timeout_s: float) -> bytes:
        """All that it prints until its end; of more than `most_bytes`, one byte more.

        Raises TimeoutError where that takes longer.
        """
        return self.take(most_bytes + 1, timeout_s)

    def wait(self, timeout_s: float | None = None) -> int:
        """Its exit code, once it has ended. Raises TimeoutError where that takes longer."""
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired as error:
            raise TimeoutError(f"no end after {timeout_s:g} s") from error

    def how_ended(self) -> str:
        """How it ended, in words: its signal, or the last line that it printed as an error."""
        code = self.wait()
        if code < 0:
            return signal.Signals(-code).name
        self._listening.join(_LAST_WORDS_S)
        lines = bytes(self._last_words).decode(errors="replace").splitlines()
        return lines[-1][:_LONGEST_WORDS] if lines else f"exit code {code}"

    def _feed(self, data: bytes) -> None:
        left = memoryview(data)
        with suppress(OSError, ValueError):  # it may have ended
            while left:
                left = left[os.write(self.input.fileno(), left) :]
            self.input.close()

    def _listen(self) -> None:
        assert self._process.stderr is not None
        with suppress(OSError, ValueError), self._process.stderr as pipe:
            while said := os.read(pipe.fileno(), _LAST_WORDS_BYTES):
                self._last_words += said
                del self._last_words[:-_LAST_WORDS_BYTES]


def _require_answer(ready: select.poll, end_s: float, timeout_s: float) -> None:
    """Wait until a pipe is ready. Raises TimeoutError where it is not by `end_s`."""
    left_s = end_s - time.monotonic()
    if left_s <= 0.0 or not ready.poll(1e3 * left_s):
        raise TimeoutError(f"no end after {timeout_s:g} s")


def _be_the_first_to_go() -> None:
    """Where memory runs out, Linux ends this process, and not the one that started it."""
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")


def _leave_network() -> None:
    """Go where there is no network; stay where the system does not let this process go."""
    unshare = getattr(ctypes.CDLL(None, use_errno=True), "unshare", None)
    if unshare is None or unshare(_NEW_NETWORK) == 0:
        return
    user, group = os.getuid(), os.getgid()
    if unshare(_NEW_USER | _NEW_NETWORK) == 0:
        with suppress(OSError):  # without its own number in there, it can make no files
            Path("/proc/self/setgroups").write_text("deny")
            Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
            Path("/proc/self/gid_map").write_text(f"{group} {group} 1")
