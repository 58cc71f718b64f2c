"""Any clip: a video, a folder or zip of frames, or a zip of videos."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from capture.errors import UnreadableClip
from capture.sources.archive import read_frames
from capture.sources.pieces import holds_pieces, read_pieces
from capture.sources.video import MAX_SIDE_PX, WHOLE, Clip, Window, read_video

MIN_FRAMES = 8
"""Fewer frames with the person say too little about a body."""
_ZIP_MAGIC = b"PK"


def read_clip(
    path: Path,
    max_frames: int,
    on_progress: Callable[[float], None] = lambda _: None,
    should_stop: Callable[[], bool] = lambda: False,
    *,
    max_side: int = MAX_SIDE_PX,
    window: Window = WHOLE,
) -> Clip:
    """At most `max_frames` frames, spread evenly over the clip at `path`, cut to `window` and made
    no larger than `max_side`.

    Raises UnreadableClip where it is none or has fewer than `MIN_FRAMES`, CaptureStopped.
    """
    if path.is_dir():
        read = read_frames
    elif _is_zip(path):
        read = read_pieces if holds_pieces(path) else read_frames
    else:
        read = read_video
    clip = read(
        path,
        max_frames=max_frames,
        max_side=max_side,
        window=window,
        on_progress=on_progress,
        should_stop=should_stop,
    )
    if len(clip.images) < MIN_FRAMES:
        raise UnreadableClip(
            f"the clip must have at least {MIN_FRAMES} frames; got {len(clip.images)}; film 10 "
            "seconds or more"
        )
    return clip


def _is_zip(path: Path) -> bool:
    if path.suffix.lower() == ".zip":
        return True
    try:
        with path.open("rb") as file:
            return file.read(2) == _ZIP_MAGIC
    except OSError:
        return False
