"""A clip in several recordings: videos in one zip, one after the other, all of one camera."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from capture.errors import UnreadableClip
from capture.sources.archive import PICTURES, opened_archive
from capture.sources.video import (
    MAX_FRAMES,
    MAX_SIDE_PX,
    WHOLE,
    Clip,
    Window,
    evenly_spaced,
    probe_video,
    read_video,
)
from scene.arrays import Array

VIDEOS = (".mp4", ".mov", ".webm", ".mkv")
_BETWEEN_S = 1.0
"""Taken to pass between two recordings: how long it was is unknown, and no motion goes on."""


def holds_pieces(path: Path) -> bool:
    """Whether the zip at `path` holds videos and no pictures. Raises as `opened_archive` does."""
    with opened_archive(path, (*PICTURES, *VIDEOS)) as (names, _):
        return bool(names) and all(name.lower().endswith(VIDEOS) for name in names)


@contextmanager
def unpacked_videos(path: Path) -> Iterator[list[Path]]:
    """The videos of a zip as files, by natural order of their names, while the context lasts."""
    with opened_archive(path, VIDEOS) as (names, read), tempfile.TemporaryDirectory() as folder:
        pieces = []
        for number, name in enumerate(names):
            piece = Path(folder) / f"{number}-{Path(name).name}"
            piece.write_bytes(read(name))
            pieces.append(piece)
        yield pieces


def read_pieces(
    path: Path,
    *,
    max_frames: int = MAX_FRAMES,
    max_side: int = MAX_SIDE_PX,
    window: Window = WHOLE,
    on_progress: Callable[[float], None] = lambda _: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Clip:
    """At most `max_frames` frames, spread evenly over all recordings in the zip at `path`, each cut
    to `window` and made no larger than `max_side`.

    Raises UnreadableClip for a broken archive or video and for recordings of different sizes,
    CaptureStopped when asked to stop.
    """
    with unpacked_videos(path) as pieces:
        counts = np.array([probe_video(piece).frames for piece in pieces])
        ends = np.cumsum(counts)
        chosen = np.searchsorted(ends, evenly_spaced(int(ends[-1]), max_frames), side="right")
        wanted = np.bincount(chosen, minlength=len(pieces))
        clips: list[Clip] = []
        for piece, frames, end, count in zip(pieces, wanted, ends, counts, strict=True):
            if frames == 0:
                continue
            done, share = (end - count) / ends[-1], count / ends[-1]
            clips.append(
                read_video(
                    piece,
                    max_frames=int(frames),
                    max_side=max_side,
                    window=window,
                    on_progress=lambda part, done=done, share=share: on_progress(
                        done + share * part
                    ),
                    should_stop=should_stop,
                )
            )
            _check_size(path, clips)
    return Clip(
        tuple(image for clip in clips for image in clip.images),
        _joined_times(clips),
        clips[0].source_size,
        int(ends[-1]),
        len(clips),
    )


def _joined_times(clips: list[Clip]) -> Array:
    times, start_s = [], 0.0
    for clip in clips:
        times.append(start_s + clip.times_s)
        start_s = float(times[-1][-1]) + _BETWEEN_S
    return np.concatenate(times)


def _check_size(path: Path, clips: list[Clip]) -> None:
    first, last = clips[0].source_size, clips[-1].source_size
    if last != first:
        raise UnreadableClip(
            f"all recordings in {path.name} must be {first[0]} x {first[1]} as the first; got "
            f"{last[0]} x {last[1]} in number {len(clips)}; record them with one camera"
        )
