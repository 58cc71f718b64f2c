"""Frames as pictures: a folder, or a zip that is read without being unpacked to disk.

No name of a zip is ever written to, so one that points outside can do no harm; it is refused all
the same, since an honest program makes none. Sizes are checked twice: as declared, and while
inflating.
"""

from __future__ import annotations

import io
import re
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

import av
import cv2
import numpy as np
from av.error import FFmpegError

from capture.errors import CaptureStopped, UnreadableClip
from capture.sources.video import (
    MAX_FRAMES,
    MAX_PIXELS,
    MAX_SIDE_PX,
    WHOLE,
    Clip,
    Window,
    evenly_spaced,
    shrink,
)
from scene.arrays import Array, UInt8

PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".bmp")
MAX_ENTRIES = 20_000
MAX_PICTURE_BYTES = 64 * 2**20
MAX_TOTAL_BYTES = 8 * 2**30
MAX_RATIO = 200
"""Declared bytes a stored byte. Pictures are compressed already: honest zips stay below 5."""

_BROKEN_ENTRY = (
    zipfile.BadZipFile,
    zlib.error,
    RuntimeError,  # encrypted
    NotImplementedError,  # packed in a way unknown here
    EOFError,
    OSError,
)

Reader = Callable[[str], bytes]


def read_frames(
    path: Path,
    *,
    frames_per_second: float = 30.0,
    max_frames: int = MAX_FRAMES,
    max_side: int = MAX_SIDE_PX,
    window: Window = WHOLE,
    on_progress: Callable[[float], None] = lambda _: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Clip:
    """The pictures in a folder or zip, by natural order of their names, `frames_per_second` apart.

    Each is cut to `window` and made no larger than `max_side`.

    Raises UnreadableClip for a broken or dangerous archive, no pictures, an empty or broken
    picture, pictures of different sizes; CaptureStopped when asked to stop.
    """
    with opened_archive(path, PICTURES) as (names, read):
        if not names:
            raise UnreadableClip(
                f"{path.name} must hold pictures ({', '.join(PICTURES)}); got none; add the frames"
            )
        chosen = evenly_spaced(len(names), max_frames)
        images: list[Array] = []
        sizes: list[tuple[int, int]] = []
        for done, index in enumerate(chosen):
            if should_stop():
                raise CaptureStopped("capture was stopped while reading the frames")
            on_progress(done / len(chosen))
            picture = decode_picture(names[index], read(names[index]))
            sizes.append((picture.shape[1], picture.shape[0]))
            if sizes[-1] != sizes[0]:
                raise UnreadableClip(
                    f"all frames must be {sizes[0][0]} x {sizes[0][1]} as the first; got "
                    f"{sizes[-1][0]} x {sizes[-1][1]} in {names[index]}; use one camera's frames"
                )
            images.append(shrink(picture[window], max_side))
        return Clip(tuple(images), chosen / frames_per_second, sizes[0], len(names))


def decode_picture(name: str, data: bytes) -> UInt8[Array, "H W 3"]:
    """RGB pixels of an encoded picture; its size is checked before it is decoded."""
    if not data:
        raise UnreadableClip(f"{name} must be a picture; got 0 bytes; remove it or save it again")
    try:
        with av.open(io.BytesIO(data)) as probe:
            width, height = probe.streams.video[0].width, probe.streams.video[0].height
    except (FFmpegError, IndexError, ValueError) as error:
        raise _no_picture(name, data) from error
    if width * height > MAX_PIXELS:
        raise UnreadableClip(
            f"{name} must have at most {MAX_PIXELS} pixels; got {width} x {height}; make it smaller"
        )
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error as error:  # a size that OpenCV itself refuses
        raise _no_picture(name, data) from error
    if pixels is None:
        raise _no_picture(name, data)
    return np.ascontiguousarray(pixels[..., ::-1])


@contextmanager
def opened_archive(path: Path, suffixes: tuple[str, ...]) -> Iterator[tuple[list[str], Reader]]:
    """Names with one of `suffixes` in a folder or zip, by natural order, and what reads one.

    Raises UnreadableClip for a broken or dangerous archive.
    """
    if path.is_dir():
        files = {f.name: f for f in path.iterdir() if f.is_file() and _is_wanted(f.name, suffixes)}
        yield _in_order(files), lambda name: _read_file(files[name])
        return
    try:
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        raise UnreadableClip(
            f"{path.name} must be a folder or a zip of frames; got {error}; zip it again"
        ) from error
    with archive:
        _check_entries(archive, path.name)
        names = [i.filename for i in archive.infolist() if _is_wanted(i.filename, suffixes)]
        yield _in_order(names), lambda name: _inflate(archive, name)


def _is_wanted(name: str, suffixes: tuple[str, ...]) -> bool:
    parts = PurePosixPath(name).parts
    hidden = any(part.startswith((".", "__MACOSX")) for part in parts)
    return not hidden and name.lower().endswith(suffixes)


def _in_order(names: dict[str, Path] | list[str]) -> list[str]:
    """frame2 before frame10."""
    return sorted(
        names, key=lambda n: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", n)]
    )


def _read_file(path: Path) -> bytes:
    size = path.stat().st_size
    if size > MAX_PICTURE_BYTES:
        raise _too_large(path.name, size)
    return path.read_bytes()


def _check_entries(archive: zipfile.ZipFile, name: str) -> None:
    entries = archive.infolist()
    if len(entries) > MAX_ENTRIES:
        raise UnreadableClip(
            f"{name} must have at most {MAX_ENTRIES} entries; got {len(entries)}; cut the clip"
        )
    for entry in entries:
        path = PurePosixPath(entry.filename.replace("\\", "/"))
        if path.is_absolute() or ".." in path.parts or re.match(r"[A-Za-z]:", entry.filename):
            raise UnreadableClip(
                f"every name in {name} must stay inside the archive; got {entry.filename!r}; "
                "zip the folder of frames itself"
            )
        if stat.S_ISLNK(entry.external_attr >> 16):
            raise UnreadableClip(
                f"{name} must hold files, no links; got the link {entry.filename!r}; zip the files"
            )
        if entry.file_size > MAX_PICTURE_BYTES:
            raise _too_large(entry.filename, entry.file_size)
        if entry.file_size > MAX_RATIO * max(entry.compress_size, 1) + 4096:
            raise UnreadableClip(
                f"{entry.filename} in {name} must grow at most {MAX_RATIO} times when unpacked; "
                f"got {entry.compress_size} to {entry.file_size} bytes; zip pictures, not raw data"
            )
    total = sum(entry.file_size for entry in entries)
    if total > MAX_TOTAL_BYTES:
        raise UnreadableClip(
            f"{name} must unpack to at most {MAX_TOTAL_BYTES} bytes; got {total}; cut the clip"
        )


def _inflate(archive: zipfile.ZipFile, name: str) -> bytes:
    """One entry. It is read one byte past what is allowed, whatever its header declares."""
    try:
        with archive.open(name) as stream:
            data = stream.read(MAX_PICTURE_BYTES + 1)
    except _BROKEN_ENTRY as error:
        raise UnreadableClip(
            f"{name} must be a whole, unencrypted entry; got {error}; zip the frames again"
        ) from error
    if len(data) > MAX_PICTURE_BYTES:
        raise _too_large(name, len(data))
    return data


def _no_picture(name: str, data: bytes) -> UnreadableClip:
    return UnreadableClip(
        f"{name} must be a picture ({', '.join(PICTURES)}); got {len(data)} bytes that are none; "
        "save it again"
    )


def _too_large(name: str, size: int) -> UnreadableClip:
    return UnreadableClip(
        f"{name} must have at most {MAX_PICTURE_BYTES} bytes; got {size}; save it as PNG or JPEG"
    )
