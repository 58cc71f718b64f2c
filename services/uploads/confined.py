"""The process that looks at one upload (services.confinement):

    python -m services.uploads.confined PATH NAME
    python -m services.uploads.confined --panorama WIDEST_PX      the picture by standard input

One line of JSON on standard output says what was found (`kind`; `shape`, which the pixels of a
panorama follow), or why it is refused (`refused`, `error`), or that the disk is full (`errno`).
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from services.confinement import Limits, confine, outcome

if TYPE_CHECKING:  # nothing is loaded before this process is confined
    from scene.arrays import Array, UInt8

MEMORY_BYTES = 3 << 30
"""Of addresses: a frame of 8K takes a tenth of a gigabyte, libraries half of one."""
PROCESSOR_S = 60
PANORAMA = "--panorama"
_OPEN_FILES = 64
_LEAST_FILE_BYTES = 64 << 20
_UNPACKED = 4
"""How much larger than the upload a file may be that is unpacked from it."""


def main(path: Path, name: str) -> None:
    """Look at `path` and print what was found."""
    confine_for(path.stat().st_size, path)

    def look() -> dict[str, object]:
        from services.uploads.check import check_upload

        return {"kind": check_upload(path, name).kind}

    _answer(outcome(look))


def show_panorama(widest_px: int) -> None:
    """Write what `read_panorama` makes of standard input."""
    confine_for(0)
    pixels = bytearray()

    def look() -> dict[str, object]:
        seen = read_panorama(sys.stdin.buffer.read(), widest_px)
        pixels.extend(seen.tobytes())
        return {"shape": seen.shape}

    _answer(outcome(look), pixels)


def read_panorama(picture: bytes, widest_px: int) -> UInt8[Array, "H W 3"]:
    """An equirectangular picture (JPEG, PNG), made no wider than `widest_px`.

    Raises UnreadableClip for what is no picture or too large a one, InvalidInput for one that isn't
    twice as wide as high.
    """
    import cv2
    import numpy as np

    from capture.errors import UnreadableClip
    from capture.sources.archive import decode_picture
    from scene.lighting import require_panorama

    try:
        seen = decode_picture("panorama", picture)
    except AttributeError as error:  # of no known codec: PyAV's stream has no size
        raise UnreadableClip(f"a panorama must be a JPEG or PNG; got {error}") from error
    require_panorama(seen.astype(np.float32))
    if seen.shape[1] <= widest_px:
        return seen
    return cv2.resize(seen, (widest_px, widest_px // 2), interpolation=cv2.INTER_AREA)


def confine_for(upload_bytes: int, *paths: Path) -> None:
    """Limit this process for good to what an upload of this size may take, and to these files."""
    largest = max(_LEAST_FILE_BYTES, _UNPACKED * upload_bytes)
    limits = Limits(MEMORY_BYTES, PROCESSOR_S, largest, _OPEN_FILES)
    confine(limits, paths, [Path(tempfile.gettempdir())])


def _answer(found: dict[str, object], rest: bytes | bytearray = b"") -> None:
    sys.stdout.buffer.write(f"{json.dumps(found)}\n".encode() + rest)


if __name__ == "__main__":
    if sys.argv[1] == PANORAMA:
        show_panorama(int(sys.argv[2]))
    else:
        main(Path(sys.argv[1]), sys.argv[2])
