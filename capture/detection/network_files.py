"""The landmark models' files: given by path, or fetched once from its maker and checked by hash."""

from __future__ import annotations

import hashlib
import http.client
import logging
import os
import tempfile
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from capture.errors import PoseModelMissing

log = logging.getLogger(__name__)

_PUBLISHED = "https://storage.googleapis.com/mediapipe-models"
_OPTIONAL_TIMEOUT_S = 5.0
"""For models that captures do without: offline, each capture waits for each of them."""


@dataclass(frozen=True)
class LandmarkNetwork:
    """One of MediaPipe's models (`.task`)."""

    name: str
    """In messages and in settings."""
    url: str
    """Where its maker publishes it."""
    known_sha256: Mapping[str, str]
    """Files that are known to be good, and what they are: no others are taken from there."""
    timeout_s: float = 30.0
    """How long a server may stay silent while the file is fetched."""

    @property
    def setting(self) -> str:
        """The environment's name of its path."""
        return f"METANERF_{self.name.upper()}_MODEL"

    @property
    def file_name(self) -> str:
        """As it is published."""
        return self.url.rsplit("/", 1)[-1]


POSE_MODEL = LandmarkNetwork(
    "pose",
    f"{_PUBLISHED}/pose_landmarker/pose_landmarker_full/float16/1/pose_landmarker_full.task",
    {
        "5134a3aad27a58b93da0088d431f366da362b44e3ccfbe3462b3827a839011b1": "published, version 1",
        "6864611cbbb7ab26be3507a5db5bd6ab69fd24aa1f1813ace1cc2f7e71bf8093": "bundled from the "
        "networks of the mediapipe 0.10.21 wheel",
    },
)
FACE_MODEL = LandmarkNetwork(
    "face",
    f"{_PUBLISHED}/face_landmarker/face_landmarker/float16/1/face_landmarker.task",
    {"64184e229b263107bc2b804c6625db1341ff2bb731874b0bcc2fe6544e0bc9ff": "published, version 1"},
    _OPTIONAL_TIMEOUT_S,
)
HAND_MODEL = LandmarkNetwork(
    "hand",
    f"{_PUBLISHED}/hand_landmarker/hand_landmarker/float16/1/hand_landmarker.task",
    {"fbc2a30080c3c557093b5ddfc334698132eb341044ccee322ccf8bcf3607cde1": "published, version 1"},
    _OPTIONAL_TIMEOUT_S,
)
MAX_BYTES = 200 * 2**20
_BLOCK = 1 << 20


@dataclass(frozen=True)
class NetworkSource:
    """Where the model file comes from."""

    path: Path | None = None
    """The file itself, used as it is; None: it is fetched from its maker."""
    folder: Path = Path.home() / ".cache" / "metanerf"
    """Where a fetched file is kept."""
    model: LandmarkNetwork = POSE_MODEL


def landmark_network_file(source: NetworkSource | Path) -> Path:
    """The model file of `source`, fetched now if it must be.

    Raises PoseModelMissing if it is absent, can't be fetched or is another file than expected.
    """
    if isinstance(source, Path):
        source = NetworkSource(source)
    if source.path is not None:
        _require_file(source, source.path)
        return source.path
    kept = source.folder / source.model.file_name
    if kept.is_file():
        if _sha256(kept) in source.model.known_sha256:
            return kept
        kept.unlink()
    return _fetch(source.model, kept)


def optional_network_file(source: NetworkSource | Path) -> Path | None:
    """The same of faces or hands, without which everything else goes on: None if it is missing."""
    try:
        return landmark_network_file(source)
    except PoseModelMissing as error:
        log.warning("face or hands stay at rest: %s", error)
        return None


def require_given(
    pose: NetworkSource | Path | None,
    face: NetworkSource | Path | None,
    hand: NetworkSource | Path | None,
) -> None:
    """Raise PoseModelMissing where a path is given that is not that of its model's file.

    Nothing is fetched: what must be, is not looked at.
    """
    for model, source in ((POSE_MODEL, pose), (FACE_MODEL, face), (HAND_MODEL, hand)):
        if isinstance(source, Path):
            source = NetworkSource(source, model=model)
        if source is not None and source.path is not None:
            _require_file(source, source.path)


def _require_file(source: NetworkSource, path: Path) -> None:
    model = source.model
    if not path.is_file():
        raise PoseModelMissing(
            f"the {model.name} model must be a file; got {path}; set {model.setting} to "
            f"a {model.file_name}, or unset it to have it fetched"
        )


def _fetch(model: LandmarkNetwork, kept: Path) -> Path:
    kept.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{kept.name}.", dir=kept.parent)
    arriving = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            digest = _download(model, file)
        _require_known(digest, model)
        arriving.replace(kept)
    except (OSError, ValueError, http.client.HTTPException) as error:
        if isinstance(error, PoseModelMissing):
            raise
        raise PoseModelMissing(
            f"the {model.name} model must be fetched once from {model.url}; got {error}; check the "
            f"network, or download it elsewhere and set {model.setting} to the file"
        ) from error
    finally:
        arriving.unlink(missing_ok=True)
    return kept


def _download(model: LandmarkNetwork, file) -> str:
    digest, size = hashlib.sha256(), 0
    with urllib.request.urlopen(model.url, timeout=model.timeout_s) as response:
        while block := response.read(_BLOCK):
            size += len(block)
            if size > MAX_BYTES:
                raise PoseModelMissing(
                    f"the {model.name} model must have at most {MAX_BYTES} bytes; got more from "
                    f"{model.url}"
                )
            digest.update(block)
            file.write(block)
    return digest.hexdigest()


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _require_known(found: str, model: LandmarkNetwork) -> None:
    if found not in model.known_sha256:
        raise PoseModelMissing(
            f"the {model.name} model's sha256 must be one of the known "
            f"{', '.join(model.known_sha256)}; got {found} from {model.url}; if you trust that "
            f"file, download it and set {model.setting} to its path"
        )
