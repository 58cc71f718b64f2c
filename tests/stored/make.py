"""Write the files of this folder with the code of commit c51c977, whose modules it imports.

Run it in a checkout of that commit, as README.md says: `make.py FOLDER`.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import zipfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from capture.store import open_sequence
from capture.studio import make_sequence
from renderer.checkpoint import load_model, save_model
from renderer.field.settings import FAST
from renderer.field.sizes import GridSize
from renderer.presets import Preset
from renderer.splats.settings import SplatSettings
from renderer.training import train
from scene.motion import Motion
from scene.sequence import NOVEL_VIEW, Sequence

SPLATS = Preset("splats", "a few hundred splats", SplatSettings(count=400))
FIELD = Preset(
    "fast",
    "a coarse grid",
    replace(
        FAST,
        sizes=replace(FAST.sizes, grid=GridSize(0.04, 4, 0.04, 0.04), volume=(8, 24, 24)),
    ),
)
VIEW, POSE = 2, 3
"""The test camera and the pose that pictures of models are drawn with."""


def ticking():
    """A clock that moves on by a hundredth of a second at every look."""
    now_s = 0.0

    def clock() -> float:
        nonlocal now_s
        now_s += 0.01
        return now_s

    return clock


def zip_folder(folder: Path, out: Path) -> None:
    """Every file of `folder`, with the same dates whenever it is run."""
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                entry = zipfile.ZipInfo(str(path.relative_to(folder)))
                archive.writestr(entry, path.read_bytes(), zipfile.ZIP_DEFLATED, 9)


def described(motion: Motion) -> dict:
    """What a motion must be read as."""
    parts = ("times_s", "joint_angles", "root_translation", "expressions")
    return {name: np.round(getattr(motion, name), 6).tolist() for name in parts}


def make_session(work: Path, out: Path) -> tuple[Sequence, dict]:
    """A performer who talks and moves their fingers, for the most fields of a sequence."""
    folder = work / "sequence"
    make_sequence(folder, frames=8, size=64, test_cameras=4, expressions=True)
    zip_folder(folder, out / "sequence.zip")
    clip = open_sequence(folder)
    splits = {"train": clip.train, **clip.test}
    return clip, {
        "person": clip.person,
        "frames_per_second": clip.frames_per_second,
        "data_hash": clip.data_hash,
        "exact_poses": clip.exact_poses,
        "motion": described(clip.motion),
        "rest_joints": np.round(clip.body.skeleton.rest_joints, 6).tolist(),
        "means": {
            name: [
                [float(split.image(i).mean()), float(split.mask(i).mean())]
                for i in range(len(split))
            ]
            for name, split in splits.items()
        },
    }


def make_model(clip: Sequence, preset: Preset, out: Path, **options) -> dict:
    """A model file, and the picture that the file's own model draws: premultiplied, RGBA."""
    save_model(train(clip, preset=preset, clock=ticking(), **options), out)
    model = load_model(out)
    picture = model.render(clip.test[NOVEL_VIEW].camera(VIEW), model.motion.pose(POSE))
    pixels = np.rint(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)
    cv2.imwrite(str(out.with_suffix(".png")), cv2.cvtColor(pixels, cv2.COLOR_RGBA2BGRA))
    return {
        "preset": model.preset,
        "data_hash": model.data_hash,
        "metrics": model.metrics,
        "motion": described(model.motion),
    }


def main(out: Path) -> None:
    """Write everything to `out`."""
    out.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp())
    clip, session = make_session(work, out)
    expected = {
        "sequence": session,
        "splats": make_model(
            clip, SPLATS, out / "splats.safetensors", iterations=120, find_light=True
        ),
        "field": make_model(clip, FIELD, out / "field.safetensors", iterations=40),
    }
    (out / "expected.json").write_text(json.dumps(expected) + "\n")
    shutil.rmtree(work)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
