"""Looks at uploads in processes of their own, which may crash without harm (`confined`)."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import capture.errors
from capture.errors import CaptureError, UnreadableClip
from db.models import SequenceKind
from services.uploads.check import Checked, check_upload, sniff
from services.uploads.confined import MEMORY_BYTES, PROCESSOR_S

_LOOK_S = 120.0
"""More than the processor's time, for a machine that does much else."""
_PASSED_ON = ("PATH", "TMPDIR", "LANG", "LD_LIBRARY_PATH")
"""Of the environment, whose other variables may be secret."""


def check_upload_apart(path: Path, name: str) -> Checked:
    """As `check_upload`. Keypoints, which no C code decodes, are looked at here.

    Raises also UnreadableClip where the process that looked did not come to an end.
    """
    kind = sniff(path, name)
    if kind is SequenceKind.KEYPOINTS:
        return check_upload(path, name)
    found = _found(path, name)
    if "errno" in found:
        raise OSError(found["errno"], os.strerror(found["errno"]))
    if "refused" in found:
        error = getattr(capture.errors, found["error"], UnreadableClip)
        raise (error if issubclass(error, CaptureError) else UnreadableClip)(found["refused"])
    return Checked(SequenceKind(found["kind"]))


def _found(path: Path, name: str) -> dict:
    environment = {key: os.environ[key] for key in _PASSED_ON if key in os.environ}
    environment |= {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OMP_NUM_THREADS": "1"}
    environment["OPENBLAS_NUM_THREADS"] = "1"
    try:
        ended = subprocess.run(
            [sys.executable, "-m", "services.uploads.confined", str(path), name],
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_LOOK_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise _never_ended(name, f"no end after {_LOOK_S:g} s") from error
    if ended.returncode != 0:
        raise _never_ended(name, _how(ended))
    return json.loads(ended.stdout.splitlines()[-1])


def _how(ended: subprocess.CompletedProcess[bytes]) -> str:
    """How a process ended, in words."""
    if ended.returncode < 0:
        return signal.Signals(-ended.returncode).name
    said = ended.stderr.decode(errors="replace").splitlines()
    return said[-1] if said else f"exit code {ended.returncode}"


def _never_ended(name: str, how: str) -> UnreadableClip:
    return UnreadableClip(
        f"{name!r} must be read within {PROCESSOR_S} s and {MEMORY_BYTES >> 30} GB; got {how} "
        "while it was looked at; export it again, smaller"
    )
