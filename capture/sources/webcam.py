"""Record with a webcam: a clip on disk, captured afterwards like any other."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from capture.errors import CaptureStopped, UnreadableClip
from capture.overlay import write_video
from scene.arrays import Array

RATE = 30.0
"""Frames/s asked of the webcam; what it gives is measured."""


def record_webcam(
    index: int,
    seconds: float,
    should_stop: Callable[[], bool] = lambda: False,
    *,
    folder: Path | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Path:
    """Record for `seconds` with webcam `index` (0 is the first); returns the MP4 in `folder`.

    Without `folder` a fresh temporary one is made, which the caller removes. Stopping early keeps
    what was recorded. Raises UnreadableClip if the webcam can't be opened or gives no picture.
    """
    folder = folder or Path(tempfile.mkdtemp(prefix="metanerf-webcam-"))
    path = folder / "webcam.mp4"
    with _webcam(index) as webcam:
        frames: list[Array] = []
        start = clock()
        while clock() - start < seconds and not should_stop():
            ok, picture = webcam.read()
            if ok:
                frames.append(np.ascontiguousarray(picture[..., ::-1]))
            elif not frames:
                raise UnreadableClip(
                    f"webcam {index} must give pictures; got none; is another program using it?"
                )
            else:
                break
        recorded_s = clock() - start
    if not frames:
        raise CaptureStopped("capture was stopped before the webcam gave a picture")
    write_video(iter(frames), path, len(frames) / max(recorded_s, 1e-3))
    return path


@contextmanager
def _webcam(index: int) -> Iterator[cv2.VideoCapture]:
    webcam = cv2.VideoCapture(index)
    try:
        if not webcam.isOpened():
            raise UnreadableClip(
                f"webcam {index} must be one that can be opened; got none there; plug it in, allow "
                "access to it, or try another number"
            )
        webcam.set(cv2.CAP_PROP_FPS, RATE)
        yield webcam
    finally:
        webcam.release()
