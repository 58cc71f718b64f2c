"""How long reading a large data set takes: every picture decoded and cut to the person."""

from __future__ import annotations

import os
import pickle
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.foreign.dataset import write_training_frames
from benchmarks.reporting.figures import FigureWriter
from capture.sources.readers import open_folder
from renderer.splats.training.views import read_views

FRAMES, SIZE = 456, 1024
"""As a person of ZJU-MoCap has."""
MUST_S, AIM_S = 20.0, 8.0
_DRAWN = 24
"""Different pictures; the others are the same files under other names."""


def run(writer: FigureWriter) -> None:
    """Measure and report."""
    writer.write(measure_reading())


def measure_reading(frames: int = FRAMES, size: int = SIZE) -> dict[str, Any]:
    """Seconds on the wall from a folder to the views that training takes, and their MiB."""
    with TemporaryDirectory() as name:
        folder = Path(name) / "clip"
        write_training_frames(folder, size, min(_DRAWN, frames))
        _repeat(folder, frames)
        began = time.perf_counter()
        views = read_views(open_folder(folder).train)
        seconds = time.perf_counter() - began
    return {
        "frames": len(views),
        "size": size,
        "threads": len(os.sched_getaffinity(0)),
        "seconds": round(seconds, 2),
        "kept_mib": round(sum(view.rgba.nbytes for view in views) / 2**20, 1),
        "must_s": MUST_S,
        "aim_s": AIM_S,
    }


def _repeat(folder: Path, frames: int) -> None:
    """Give the folder `frames` frames, by further names for those that it has."""
    tables = {kind: folder / f"{kind}.pkl" for kind in ("cameras", "mesh_infos")}
    contents = {kind: pickle.loads(path.read_bytes()) for kind, path in tables.items()}
    names = sorted(contents["cameras"])
    for number in range(len(names), frames):
        like, name = names[number % len(names)], f"frame_{number:06d}"
        for content in contents.values():
            content[name] = content[like]
        for kind in ("images", "masks"):
            (folder / kind / f"{name}.png").hardlink_to(folder / kind / f"{like}.png")
    for kind, path in tables.items():
        path.write_bytes(pickle.dumps(contents[kind], protocol=4))
