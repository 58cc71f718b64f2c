"""What kind of file an upload is, by its bytes and not its name, and whether it can be used."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path

from capture.errors import UnreadableClip
from capture.sources.archive import PICTURES, read_frames
from capture.sources.pieces import holds_pieces, unpacked_videos
from capture.sources.video import probe_video
from db.models import SequenceKind
from db.objects import no_space
from scene.errors import SceneError
from scene.motion import Motion

_HEAD_BYTES = 4096
_MAX_KEYPOINTS_BYTES = 64 << 20
_LOOKED_AT = 4
"""Frames of an archive that are decoded at once; capture looks at all."""

_VIDEO_MARKS = (
    (4, b"ftyp"),  # ISO base media: mp4, mov
    (0, b"\x1a\x45\xdf\xa3"),  # EBML: webm, mkv
    (8, b"AVI "),
    (0, b"\x00\x00\x01\xba"),  # MPEG program stream
    (0, b"OggS"),
    (0, b"FLV\x01"),
    (4, b"moov"),
    (4, b"mdat"),
    (4, b"wide"),
)


@dataclass(frozen=True)
class Checked:
    """An upload that can be used."""

    kind: SequenceKind
    motion: Motion | None = None
    """Of keypoints, which need no capture."""


def check_upload(path: Path, name: str) -> Checked:
    """What `path` holds. Raises CaptureError with the rule that it breaks; `name` is for people."""
    try:
        return _checked(path, name)
    except (ValueError, ArithmeticError, AttributeError, OSError) as error:
        # a number or a name of an entry beyond what its reader foresaw, or a video of no known
        # codec, whose stream has no size in PyAV; a full disk is no such
        if isinstance(error, SceneError) or no_space(error):
            raise
        raise UnreadableClip(
            f"{name!r} must hold what can be read; got {error}; export it again"
        ) from error


def _checked(path: Path, name: str) -> Checked:
    kind = sniff(path, name)
    if kind is SequenceKind.KEYPOINTS:
        from capture.sources.keypoints import read_keypoints

        return Checked(kind, read_keypoints(path))
    if kind is SequenceKind.VIDEO:
        _check_video(path, name)
    elif holds_pieces(path):
        with unpacked_videos(path) as pieces:
            for piece in pieces:
                _check_video(piece, piece.name)
    else:
        _check_archive(path)
    return Checked(kind)


def sniff(path: Path, name: str) -> SequenceKind:
    """The kind of file that `path` is. Raises UnreadableClip for any other."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if head.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        return SequenceKind.FRAMES
    if any(head[at : at + len(mark)] == mark for at, mark in _VIDEO_MARKS) or _is_transport(head):
        return SequenceKind.VIDEO
    if head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith((b"{", b"[")) and _is_json(path):
        return SequenceKind.KEYPOINTS
    raise UnreadableClip(
        f"{name!r} must be a video (mp4, mov, webm, mkv), a zip of frames or of videos, or "
        f"keypoints as JSON; got {_kind_of(head)}; choose the video itself, or export it again"
    )


def _kind_of(head: bytes) -> str:
    """What a file that begins like this is to whoever named it after a video."""
    if not head:
        return "an empty file"
    text = head.decode("utf-8", "ignore")
    if all(one.isprintable() or one.isspace() for one in text) and len(text) > len(head) // 2:
        return "a text file"
    return "a file of another kind"


def _check_video(path: Path, name: str) -> None:
    if probe_video(path).frames == 0:
        raise UnreadableClip(f"{name!r} must hold at least one frame; got none; film it again")


def _check_archive(path: Path) -> None:
    read_frames(path, max_frames=_LOOKED_AT, max_side=64)
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            if entry.filename.lower().endswith(PICTURES) and entry.file_size == 0:
                raise UnreadableClip(
                    f"{entry.filename} must be a picture; got 0 bytes; remove it or save it again"
                )


def _is_transport(head: bytes) -> bool:
    """MPEG transport stream: a sync byte every 188 bytes."""
    return len(head) > 376 and all(head[i] == 0x47 for i in (0, 188, 376))


def _is_json(path: Path) -> bool:
    if path.stat().st_size > _MAX_KEYPOINTS_BYTES:
        return False
    try:
        json.loads(path.read_bytes())
    except (ValueError, RecursionError):  # the latter: nested deeper than Python reads
        return False
    return True
