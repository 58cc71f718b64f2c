"""The image as its Dockerfile makes it, as far as a machine without a container engine can.

A mount namespace holds a root of its own: this machine's, under a layer that takes what is
written. There the Dockerfile's own lines put our files and run our commands; then the root is made
read-only, and containers are processes in it, without privileges, by the image's variables and
entry. The base image, and packages of the system and of Python, are this machine's.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from tests.deploy.composed import ROOT

USER = "10001"
"""Who runs in a container, as the Dockerfile's `useradd` says."""
_KEPT = ROOT / "build" / "image-kernels"
"""What an earlier run compiled, by the step that did: numba knows what is still good."""
_LAYERS = """
set -e
mount -t tmpfs none "$1" && cd "$1" && mkdir over work all
mount -t overlay none -o lowerdir=/,upperdir="$1/over",workdir="$1/work" all
for one in dev proc sys; do mount --rbind /$one all/$one; done
mount -t tmpfs none all/tmp && chmod 1777 all/tmp && mkdir -p all/app/kernels all/data
mount --bind "$2" all/app/kernels
echo made && exec sleep infinity
"""
_READ_ONLY = """
set -e
mount -o remount,bind,ro all/app/kernels && mount -o remount,ro all
mount -t tmpfs none all/tmp && chmod 1777 all/tmp
mount -t tmpfs none all/data && chown "$1" all/data
"""


@dataclass(frozen=True)
class Step:
    """One instruction of a Dockerfile."""

    word: str
    rest: str

    @property
    def words(self) -> list[str]:
        """What it is given."""
        return shlex.split(self.rest)


def stage(name: str) -> list[Step]:
    """The instructions of one stage of the Dockerfile."""
    text = re.sub(r"^#.*\n", "", (ROOT / "Dockerfile").read_text(), flags=re.MULTILINE)
    stages = re.split(r"^FROM \S+", text.replace("\\\n", " "), flags=re.MULTILINE)
    [found] = [one for one in stages if one.startswith(f" AS {name}\n")]
    lines = found.splitlines()[1:]
    return [Step(*line.split(maxsplit=1)) for line in lines if line.strip()]


def variables(steps: list[Step]) -> dict[str, str]:
    """The environment of the image, where its builder says nothing else."""
    defaults = dict(step.rest.split("=", 1) for step in steps if step.word == "ARG")
    pairs = (word.split("=", 1) for step in steps if step.word == "ENV" for word in step.words)
    return {name: defaults.get(value.removeprefix("$"), value) for name, value in pairs}


@dataclass(frozen=True)
class Image:
    """An image that is made, and its one container."""

    root: Path
    """Of all of it, as the namespace sees it."""
    holder: int
    """The process that keeps the namespace."""
    steps: list[Step]

    def run(self, command: list[str], **more: str) -> str:
        """What `command` prints in a container that reaches nobody."""
        process = self.start(command, offline=True, **more)
        out, told = process.communicate(timeout=300)
        assert process.returncode == 0, out + told
        return out

    def start(self, command: list[str], offline: bool = False, **more: str) -> subprocess.Popen:
        """`command` as a container has it, by the image's entry and as its user."""
        [entry] = [json.loads(step.rest) for step in self.steps if step.word == "ENTRYPOINT"]
        who = [f"--reuid={USER}", f"--regid={USER}", "--clear-groups", "--no-new-privs"]
        return subprocess.Popen(
            [
                *_entering(self.holder),
                *(["unshare", "--net"] if offline else []),
                *["chroot", str(self.root / "all"), "env", "--chdir=/app"],
                *["setpriv", *who, "--bounding-set=-all", *entry, *command],
            ],
            env=_environment(self.steps) | {"HOME": "/data"} | more,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )


@contextmanager
def built(folder: Path, models: Mapping[str, Path]) -> Iterator[Image]:
    """The image of the stage `metanerf`; `models` are the files of its addresses, by their names.

    Raises PermissionError where no namespace can be made.
    """
    steps = stage("metanerf")
    [compiling] = [step.rest for step in steps if step.word == "RUN" and "warm_up" in step.rest]
    kept = _KEPT / sha256(compiling.encode()).hexdigest()[:12]
    kept.mkdir(parents=True, exist_ok=True)
    holder = subprocess.Popen(
        ["unshare", "--mount", "sh", "-c", _LAYERS, "sh", str(folder), str(kept)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert holder.stdout is not None
    assert holder.stderr is not None
    try:
        if holder.stdout.readline() != b"made\n":
            raise PermissionError(f"a namespace must be possible; got {holder.stderr.read()!r}")
        image = Image(folder, holder.pid, steps)
        _make(image, models)
        yield image
    finally:
        holder.kill()
        holder.communicate()


def _make(image: Image, models: Mapping[str, Path]) -> None:
    outside = [*_entering(image.holder), "env", f"--chdir={image.root}"]
    app = "all/app/"
    # the image's own Python is for everybody; this one may lie in somebody's home
    passed = [f"all{parent}" for parent in Path(os.path.realpath(sys.executable)).parents]
    subprocess.run([*outside, "chmod", "o+x", *passed], check=True)
    for step in image.steps:
        words = step.words
        if step.word == "ADD":
            *_, address, place = words
            source = models[address.rpartition("/")[2]]
            subprocess.run(
                [*outside, "install", "-D", "-m", "644", source, "-t", app + place], check=True
            )
        elif step.word == "COPY" and not step.rest.startswith("--"):
            *sources, place = words
            paths = [str(ROOT / source) for source in sources]
            subprocess.run(
                [*outside, "cp", "-rT" if len(paths) == 1 else "-r", *paths, app + place],
                check=True,
            )
            # .dockerignore
            find = ["find", app, "-name", "__pycache__", "-prune", "-exec", "rm", "-r", "{}", "+"]
            subprocess.run([*outside, *find], check=True)
        elif step.word == "RUN" and words[0] in ("python", "export"):
            inside = ["chroot", "all", "env", "--chdir=/app", "sh", "-c", step.rest]
            # a builder's own habit must not show in the image
            environment = _environment(image.steps) | {"PYTHONDONTWRITEBYTECODE": "1"}
            done = subprocess.run(
                [*outside, *inside], env=environment, capture_output=True, text=True
            )
            assert done.returncode == 0, done.stdout + done.stderr
    subprocess.run([*outside, "sh", "-c", _READ_ONLY, "sh", USER], check=True)


def _entering(holder: int) -> list[str]:
    return ["nsenter", f"--target={holder}", "--mount"]


def _environment(steps: list[Step]) -> dict[str, str]:
    """The image's, with the places of this machine's Python in place of the base image's."""
    programs = f"{Path(sys.executable).parent}:/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin"
    return {"PATH": programs, "PYTHONPATH": "/app", "LANG": "C.UTF-8"} | variables(steps)
