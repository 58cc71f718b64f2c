"""The network behind LPIPS: a file that is named, or VGG-16 fetched once and checked by hash."""

from __future__ import annotations

import hashlib
import os
import tempfile
import urllib.request
from collections.abc import Callable
from pathlib import Path

from scene.errors import InvalidInput

ADDRESS = "https://download.pytorch.org/models/vgg16-397923af.pth"
SHA256 = "397923af8e79cdbb6a7127f12361acd7a2f83e06b05044ddf496e83de57a5bf0"
"""torchvision's VGG-16, the backbone of the paper's figures."""
_BYTES = 553_433_881
_TIMEOUT_S = 20.0
_BLOCK = 1 << 20


def vgg_file(
    folder: Path,
    on_progress: Callable[[float, str], None],
    address: str | None = None,
    sha256: str = SHA256,
) -> Path:
    """VGG-16's file in `folder`, fetched now (from `address` or where it is published) if it is not
    there; whole or not at all.

    Raises InvalidInput where it can't be fetched or is another file.
    """
    address = address or ADDRESS
    kept = folder / address.rsplit("/", 1)[-1]
    if kept.is_file():
        return kept
    folder.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{kept.name}.", dir=folder)
    arriving = Path(name)
    try:
        digest, size = hashlib.sha256(), 0
        with (
            os.fdopen(handle, "wb") as file,
            urllib.request.urlopen(address, timeout=_TIMEOUT_S) as response,
        ):
            while block := response.read(_BLOCK):
                digest.update(block)
                file.write(block)
                size += len(block)
                on_progress(size / _BYTES, "VGG-16, once")
        if digest.hexdigest() != sha256:
            raise ValueError(f"sha256 {digest.hexdigest()}")
        arriving.replace(kept)
    except (OSError, ValueError) as error:
        raise InvalidInput(
            f"LPIPS' backbone must be fetched once from {address} (sha256 {sha256}); got {error}; "
            "check the network, or name a VGG-16, SqueezeNet 1.1 or AlexNet file by "
            "--lpips-backbone or METANERF_LPIPS_BACKBONE"
        ) from error
    finally:
        arriving.unlink(missing_ok=True)
    return kept
