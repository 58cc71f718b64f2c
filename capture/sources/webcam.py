"""Film with a webcam: a clip on disk, captured afterwards like any other."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from capture.detection.network_files import ModelSource, require_given
from capture.errors import CaptureStopped, UnreadableClip
from capture.overlay import write_video
from capture.pipeline import capture_video
from capture.quality import CaptureQuality
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
    """Film for `seconds` with webcam `index` (0 is the first); returns the MP4 in `folder`.

    Without `folder` a fresh temporary one is made, which the caller removes. Stopping early keeps
    what was filmed. Raises UnreadableClip if the webcam can't be opened or gives no picture.
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
        filmed_s = clock() - start
    if not frames:
        raise CaptureStopped("capture was stopped before the webcam gave a picture")
    write_video(iter(frames), path, len(frames) / max(filmed_s, 1e-3))
    return path


def capture_webcam(
    index: int,
    out: Path,
    *,
    seconds: float = 15.0,
    person: str,
    pose_model: ModelSource | Path,
    **options: Any,
) -> CaptureQuality:
    """Film with webcam `index`, then capture the clip; see `capture_video` for `options`."""
    # told now: what was filmed would be lost
    require_given(pose_model, options.get("face_model"), options.get("hand_model"))
    with tempfile.TemporaryDirectory(prefix="metanerf-webcam-") as folder:
        stop = options.get("should_stop", lambda: False)
        clip = record_webcam(index, seconds, stop, folder=Path(folder))
        return capture_video(clip, out, person=person, pose_model=pose_model, **options)


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
