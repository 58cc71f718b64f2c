"""Robustness of a capture: each row degrades one thing of the same clip."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.capture import FRAMES, RATE, StageWatch, render_clip, truth_joints
from benchmarks.pose_errors import Joints
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import clock_named
from capture.detection.landmarks import Landmarks, MediaPipeEstimator, PoseEstimator
from capture.detection.lifter import lift
from capture.fitting.fit import STAGES
from capture.overlay import write_video
from capture.pipeline import CaptureOptions, capture_clip
from capture.sources.video import read_video
from capture.storage import open_sequence
from capture.studio.performer import make_performer, render_performer
from scene.arrays import Array, UInt8
from scene.sequence import Sequence

CLIP = "walk_veer_left_16_11"
_FASTEST = 60.0
_MOST_FRAMES = round(FRAMES * _FASTEST / RATE)
_FIGURES = (
    "joint_mm",
    "joint_one_scale_mm",
    "joint_procrustes_mm",
    "rotation_error_deg",
    "root_one_scale_mm",
    "scale",
    "swapped_frames",
)
_HOLES, _HOLE_SHARE = 4, 0.08
"""Holes in a mask, and their radius as a share of the person's height."""


def run(writer: FigureWriter, motions: Path, pose_model: Path) -> None:
    """Capture one clip repeatedly, degraded in one way each time."""
    rows: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as name, MediaPipeEstimator(pose_model) as estimator:
        folder = Path(name)
        render_clip(folder, motions / f"{CLIP}.bvh", 7, _FASTEST, _MOST_FRAMES)
        for row, path, seen_by, focal_known, rate in _variants(folder, estimator):
            truth = open_sequence(folder / "truth")
            watch = StageWatch(_at_rate(truth, rate), clock_named("wall"))
            size = read_video(path, max_frames=2).images[0].shape[1]
            focal_px = truth.train.camera(0).focal_px * size / truth.train.camera(0).width
            options = CaptureOptions(
                person=row,
                estimator=seen_by,
                lifter=lift,
                max_frames=_MOST_FRAMES,
                focal_px=focal_px if focal_known else None,
            )
            capture_clip(path, folder / f"{row}.seq", options, on_fit=watch.fitted)
            last = watch.stages[STAGES[-1]]
            rows[row] = {key: last[key] for key in _FIGURES}
            print(row, rows[row], flush=True)
    writer.write({"clip": CLIP, "rows": rows})


Variant = tuple[str, Path, PoseEstimator, bool, float]


def _variants(folder: Path, estimator: PoseEstimator) -> Iterator[Variant]:
    """Name, clip, estimator, whether the focal length is given, frames a second."""
    images = read_video(folder / "raw.mp4", max_frames=_MOST_FRAMES).images

    def written(name: str, pictures: Iterator[UInt8[Array, "H W 3"]], rate: float) -> Path:
        path = folder / f"{name}.mp4"
        write_video(pictures, path, rate)
        return path

    def thinned(rate: float) -> list[UInt8[Array, "H W 3"]]:
        return list(images[:: round(_FASTEST / rate)])

    usual = written("usual", iter(thinned(RATE)), RATE)
    yield "usual", usual, estimator, True, RATE
    for rate in (30.0, _FASTEST):
        path = written(f"{rate:g}_frames_a_second", iter(thinned(rate)), rate)
        yield path.stem, path, estimator, True, rate
    for share in (0.1, 0.3, 0.5):
        blind = _Degraded(estimator, _dropping_landmarks(share))
        yield f"{100 * share:g}_percent_of_landmarks_dropped", usual, blind, True, RATE
    yield "holes_in_masks", usual, _Degraded(estimator, _with_mask_holes), True, RATE
    yield "focal_length_unknown", usual, estimator, False, RATE
    halved = (
        cv2.resize(i, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for i in thinned(RATE)
    )
    yield "half_resolution", written("half", halved, RATE), estimator, True, RATE
    crossed = written("crossed", _with_passer_by(folder, thinned(RATE)), RATE)
    yield "somebody_passes_behind", crossed, estimator, True, RATE


class _Degraded:
    """An estimator whose detections are degraded, repeatably."""

    def __init__(
        self, inner: PoseEstimator, degrade: Callable[[Landmarks, np.random.Generator], Landmarks]
    ) -> None:
        self._inner, self._degrade, self._rng = inner, degrade, np.random.default_rng(0)

    def detect(self, image: UInt8[Array, "H W 3"]) -> list[Landmarks]:
        return [self._degrade(person, self._rng) for person in self._inner.detect(image)]


def _dropping_landmarks(share: float) -> Callable[[Landmarks, np.random.Generator], Landmarks]:
    def degrade(person: Landmarks, rng: np.random.Generator) -> Landmarks:
        kept = rng.uniform(size=len(person.visibility)) >= share
        return replace(person, visibility=person.visibility * kept)

    return degrade


def _with_mask_holes(person: Landmarks, rng: np.random.Generator) -> Landmarks:
    mask = person.mask.copy()
    rows, columns = np.nonzero(mask > 0.5)
    for _ in range(_HOLES if len(rows) else 0):
        at = rng.integers(len(rows))
        radius = round(_HOLE_SHARE * float(person.box[3] - person.box[1]))
        cv2.circle(mask, (int(columns[at]), int(rows[at])), radius, 0.0, -1)
    return replace(person, mask=mask)


def _with_passer_by(
    folder: Path, images: list[UInt8[Array, "H W 3"]]
) -> Iterator[UInt8[Array, "H W 3"]]:
    """`images` with another performer, who walks through behind the first."""
    truth, other = open_sequence(folder / "truth"), make_performer(40)
    step = round(_FASTEST / RATE)
    for index, image in enumerate(images):
        frame, camera = index * step, truth.train.camera(index * step)
        pose = truth.train.pose((frame + 60) % len(truth.train))
        across = np.array([-1.6 + 3.2 * index / len(images), 0.0, -1.5])
        seen, alpha = render_performer(other, replace(pose, root_translation=across), camera, "lit")
        free = 1.0 - truth.train.mask(frame)[..., None]
        mixed = image / 255.0 * (1.0 - alpha[..., None] * free) + seen * free
        yield np.clip(255.0 * mixed + 0.5, 0, 255).astype(np.uint8)


def _at_rate(truth: Sequence, rate: float) -> Joints:
    """The true joints of the frames that a clip at `rate` shows."""
    joints, step = truth_joints(truth), round(_FASTEST / rate)
    return Joints(joints.times_s[::step], joints.positions[::step], joints.local_rotations[::step])
