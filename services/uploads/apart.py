"""Looks at uploads in processes of their own, which may crash without harm (`confined`)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np

import capture.errors
from capture.errors import CaptureError, UnreadableClip
from db.models import SequenceKind
from scene.arrays import Array, UInt8
from scene.errors import InvalidInput, SceneError
from services.confinement import bare_environment, how_ended
from services.uploads.check import Checked, check_upload, sniff
from services.uploads.confined import MEMORY_BYTES, PANORAMA, PROCESSOR_S

_LOOK_S = 120.0
"""More than the processor's time, for a machine that does much else."""
_looking_at_pictures = threading.BoundedSemaphore(2)
"""So many at once: each may take all the memory that it is allowed."""


def check_upload_apart(path: Path, name: str) -> Checked:
    """As `check_upload`. Keypoints, which no C code decodes, are looked at here.

    Raises also UnreadableClip where the process that looked did not come to an end.
    """
    kind = sniff(path, name)
    if kind is SequenceKind.KEYPOINTS:
        return check_upload(path, name)
    found, _ = _look(repr(name), [str(path), name])
    return Checked(SequenceKind(found["kind"]))


def read_panorama_apart(picture: bytes, widest_px: int) -> UInt8[Array, "H W 3"]:
    """As `confined.read_panorama`: nothing of the picture is decoded here, and plain pixels come.

    Raises also UnreadableClip where the process that looked did not come to an end.
    """
    with _looking_at_pictures:
        found, pixels = _look("a panorama", [PANORAMA, str(widest_px)], picture)
    # whoever may have taken that process over says no more than pixels
    height, width, channels = (int(one) for one in found["shape"])
    of_a_panorama = 0 < width <= widest_px and height * 2 == width and channels == 3
    if not of_a_panorama or len(pixels) != height * width * channels:
        raise UnreadableClip(
            f"a panorama must be twice as wide as high; got {width} x {height}; export it again"
        )
    return np.frombuffer(pixels, np.uint8).reshape(height, width, channels)


def _look(what: str, arguments: list[str], data: bytes = b"") -> tuple[dict[str, Any], bytes]:
    """What the process that looks says first, and what follows."""
    environment = bare_environment() | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        ended = subprocess.run(
            [sys.executable, "-m", "services.uploads.confined", *arguments],
            env=environment,
            input=data,
            capture_output=True,
            timeout=_LOOK_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise _never_ended(what, f"no end after {_LOOK_S:g} s") from error
    if ended.returncode != 0:
        raise _never_ended(what, how_ended(ended.returncode, ended.stderr))
    line, _, rest = ended.stdout.partition(b"\n")
    found = json.loads(line)
    if "errno" in found:
        raise OSError(found["errno"], os.strerror(found["errno"]))
    if "refused" in found:
        raise _refusal(found["error"])(found["refused"])
    return found, rest


def _refusal(name: str) -> type[SceneError]:
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
