"""A clip that is short enough for tests: real footage, its ruler, and the networks that see it."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from itertools import islice
from pathlib import Path

import av

from benchmarks.real.measure import Networks
from benchmarks.real.ruler import Ruler
from tests.shared_data import shared_data


def networks() -> Networks:
    """Those of the shared data."""
    models = shared_data("models")
    return Networks(
        models / "pose_landmarker_full.task",
        models / "face_landmarker.task",
        models / "hand_landmarker.task",
        models / "alexnet_features.pth",
    )


def first_frames(clip: str, frames: int, folder: Path) -> Ruler:
    """The ruler of the first `frames` of `clip`, which are copied into `folder` without loss.

    Of the ruler's frames those are left that the short clip has.
    """
    ruler = Ruler.read(clip)
    source = ruler.require_footage(shared_data("real-webcam-people").parent)
    path = folder / f"{clip}{source.suffix}"
    with av.open(str(source)) as whole, av.open(str(path), "w") as short:
        filmed = whole.streams.video[0]
        video = short.add_stream("libx264", rate=filmed.average_rate, options={"qp": "0"})
        video.width, video.height, video.pix_fmt = filmed.width, filmed.height, filmed.pix_fmt
        for frame in islice(whole.decode(filmed), frames):
            short.mux(video.encode(frame))
        short.mux(video.encode(None))
    return replace(
        ruler,
        file=path.name,
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
        clip_frames=frames,
        indices=tuple(index for index in ruler.indices if index < frames),
    )
