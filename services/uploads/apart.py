"""Looks at uploads in processes of their own, which may crash without harm (`confined`)."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import capture.errors
from capture.errors import CaptureError, UnreadableClip
from db.models import SequenceKind
from scene.arrays import Array, UInt8
from scene.errors import InvalidInput, SceneError
from services.confinement import ConfinedProcess
from services.uploads.check import Checked, check_upload, sniff
from services.uploads.confined import MEMORY_BYTES, PANORAMA, PROCESSOR_S

LOOK_S = 120.0
"""More than the processor's time, for a machine that does much else."""
_LONGEST_LINE = 64 << 10
_NO_ANSWER = (
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    OverflowError,
    RecursionError,
)
Found = TypeVar("Found")


def check_upload_apart(path: Path, name: str) -> Checked:
    """As `check_upload`. Keypoints, which no C code decodes, are looked at here.

    Raises also UnreadableClip where the process that looked did not come to an end.
    """
    kind = sniff(path, name)
    if kind is SequenceKind.KEYPOINTS:
        return check_upload(path, name)
    return _look(repr(name), [str(path), name], lambda said: Checked(SequenceKind(said["kind"])))[0]


def read_panorama_apart(picture: bytes, widest_px: int) -> UInt8[Array, "H W 3"]:
    """As `confined.read_panorama`: nothing of the picture is decoded here, and plain pixels come.

    Raises also UnreadableClip where the process that looked did not come to an end.
    """
    most_bytes = 3 * widest_px * (widest_px // 2)
    (height, width, channels), pixels = _look(
        "a panorama", [PANORAMA, str(widest_px)], _shape, picture, most_bytes
    )
    # whoever may have taken that process over says no more than pixels
    of_a_panorama = 0 < width <= widest_px and height * 2 == width and channels == 3
    if not of_a_panorama or len(pixels) != height * width * channels:
        raise UnreadableClip(
            f"a panorama must be twice as wide as high; got {width} x {height}; export it again"
        )
    return np.frombuffer(pixels, np.uint8).reshape(height, width, channels)


def _look(
    what: str,
    arguments: list[str],
    read: Callable[[dict[str, Any]], Found],
    data: bytes = b"",
    most_bytes: int = 0,
) -> tuple[Found, bytes]:
    """What `read` makes of the process' first line, and the bytes that follow, bounded."""
    environment = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with (
        # ours, so that it is gone whatever becomes of the process
        tempfile.TemporaryDirectory(prefix="metanerf-look-") as folder,
        ConfinedProcess(
            "services.uploads.confined", *arguments, **environment, TMPDIR=folder
        ) as process,
    ):
        process.feed(data)
        try:
            said = process.read(_LONGEST_LINE + most_bytes, LOOK_S)
            goes_on = len(said) > _LONGEST_LINE + most_bytes
            code = 0 if goes_on else process.wait(LOOK_S)
        except TimeoutError as error:
            raise _never_ended(what, str(error)) from error
        if code != 0:
            raise _never_ended(what, process.how_ended())
    if goes_on:
        raise _never_ended(what, "more than there is to say")
    line, _, rest = said.partition(b"\n")
    try:
        answer = json.loads(line)
        full = int(answer.get("errno", 0))
        refused = refusal(answer["error"])(answer["refused"]) if "refused" in answer else None
        found = None if full or refused else read(answer)
    except _NO_ANSWER as error:  # of whoever has taken it over
        raise _never_ended(what, "an answer that is none") from error
    if full:
        raise OSError(full, os.strerror(full))
    if found is None:
        raise refused or _never_ended(what, "no answer")
    return found, rest


def _shape(said: dict[str, Any]) -> tuple[int, int, int]:
    height, width, channels = (int(one) for one in said["shape"])
    return height, width, channels


def refusal(name: str) -> type[SceneError]:
    """The error of that name which a confined process may raise: one of a clip's."""
    if name == InvalidInput.__name__:
        return InvalidInput
    error = getattr(capture.errors, name, None)
    if isinstance(error, type) and issubclass(error, CaptureError):
        return error
    return UnreadableClip


def _never_ended(what: str, how: str) -> UnreadableClip:
    return UnreadableClip(
        f"{what} must be read within {PROCESSOR_S} s and {MEMORY_BYTES >> 30} GB; got {how} "
        "while it was looked at; export it again, smaller"
    )
