"""The landmark model's file: given by path, or fetched once by address and checked by hash."""

from __future__ import annotations

import hashlib
import os
import tempfile
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path

from capture.errors import PoseModelMissing

PUBLISHED_ADDRESS = (
    "https://storage.googleapis.com/mediapipe-models/pose_landmarker/"
    "pose_landmarker_full/float16/1/pose_landmarker_full.task"
)
KNOWN_SHA256 = {
    "5134a3aad27a58b93da0088d431f366da362b44e3ccfbe3462b3827a839011b1": "published, version 1",
    "6864611cbbb7ab26be3507a5db5bd6ab69fd24aa1f1813ace1cc2f7e71bf8093": "bundled from the networks "
    "of the mediapipe 0.10.21 wheel",
}
"""Files that are known to be good; others are accepted by naming their hash."""
MAX_BYTES = 200 * 2**20
_TIMEOUT_S = 30.0
_BLOCK = 1 << 20


@dataclass(frozen=True)
class PoseModelSource:
    """Where the model file comes from."""

    path: Path | None = None
    """The file itself, used as it is (unless `sha256` says which it must be)."""
    address: str = PUBLISHED_ADDRESS
    """Where it is fetched from if there is no `path`."""
    sha256: str | None = None
    """The hash that the file must have; None accepts any of `KNOWN_SHA256`."""
    folder: Path = Path.home() / ".cache" / "metanerf"
    """Where a fetched file is kept."""


def pose_model_file(source: PoseModelSource | Path) -> Path:
    """The model file of `source`, fetched now if it must be.

    Raises PoseModelMissing if it is absent, can't be fetched or is another file than expected.
    """
    if isinstance(source, Path):
        source = PoseModelSource(path=source)
    if source.path is not None:
        if not source.path.is_file():
            raise PoseModelMissing(
                f"the pose model must be a file; got {source.path}; set METANERF_POSE_MODEL to a "
                "pose_landmarker_full.task, or unset it to have it fetched"
            )
        if source.sha256 is not None:
            _require_hash(_sha256(source.path), source.sha256, str(source.path))
        return source.path
    kept = source.folder / source.address.rsplit("/", 1)[-1]
    if kept.is_file():
        if _accepted(_sha256(kept), source.sha256):
            return kept
        kept.unlink()
    return _fetch(source, kept)


def _fetch(source: PoseModelSource, kept: Path) -> Path:
    kept.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{kept.name}.", dir=kept.parent)
    arriving = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            digest = _download(source.address, file)
        _require_hash(digest, source.sha256, source.address)
        arriving.replace(kept)
    except (urllib.error.URLError, OSError, ValueError) as error:
        if isinstance(error, PoseModelMissing):
            raise
        raise PoseModelMissing(
            f"the pose model must be fetched once from {source.address}; got {error}; check the "
            "network, or download it elsewhere and set METANERF_POSE_MODEL to the file"
        ) from error
    finally:
        arriving.unlink(missing_ok=True)
    return kept


def _download(address: str, file) -> str:
    digest, size = hashlib.sha256(), 0
    with urllib.request.urlopen(address, timeout=_TIMEOUT_S) as response:
        while block := response.read(_BLOCK):
            size += len(block)
            if size > MAX_BYTES:
                raise PoseModelMissing(
                    f"the pose model must have at most {MAX_BYTES} bytes; got more from {address}"
                )
            digest.update(block)
            file.write(block)
    return digest.hexdigest()


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _accepted(found: str, expected: str | None) -> bool:
    return found == expected.lower() if expected is not None else found in KNOWN_SHA256


def _require_hash(found: str, expected: str | None, where: str) -> None:
    if not _accepted(found, expected):
        wanted = expected or "one of the known " + ", ".join(KNOWN_SHA256)
        raise PoseModelMissing(
            f"the pose model's sha256 must be {wanted}; got {found} from {where}; if you trust "
            "that file, set METANERF_POSE_MODEL_SHA256 to its hash"
        )
