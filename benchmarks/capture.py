"""Accuracy of a capture from pixels alone, and of the model trained on it.

Studio performers move to real, recorded motion in a room, through a lens and a sensor; truth is
known. One camera can't tell a small person nearby from a tall one further away: where figures say
`one_scale`, one scale a clip was taken out, about the camera. `height_known`: a capture that knows
how tall the performer is.
"""

from __future__ import annotations

import resource
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.origin import ORIGIN
from benchmarks.reporting.timing import Clock, clock_named
from benchmarks.stability.pose_errors import (
    Joints,
    gauge_scale,
    joint_rotation_errors,
    pose_errors,
    seen_joints,
)
from capture.fitting.fit import STAGES
from capture.fitting.result import Fit
from capture.fitting.world import OPENGL_TO_OPENCV
from capture.pipeline import CaptureOptions, capture_clip
from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.footage import Footage
from renderer.evaluation.evaluate import evaluate
from renderer.performer_model import PerformerModel
from renderer.training import train
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.sequence import FrameSource, Sequence

FRAMES, RATE, SIZE_PX = 90, 15.0, 512
NOISE, BLUR_PX = 3.0, 0.6
TRAINING_S = 60.0
_WITH_HEIGHT = ("joint_mm", "joint_procrustes_mm", "rotation_error_deg", "root_mm", "scale")
_SPLITS = ("novel_view", "unseen_pose")


def run(
    writer: FigureWriter,
    motions: Path,
    pose_model: Path,
    backbone: Path | None,
    clips: int,
    clock_name: str,
    only: str,
) -> None:
    """Render, capture, train and evaluate the performers not measured yet, and report."""
    cache, clock = writer.cache(only), clock_named(clock_name)
    about = {
        "frames": FRAMES,
        "frames_per_second": RATE,
        "size": SIZE_PX,
        "noise": NOISE,
        "blur_px": BLUR_PX,
        "background": "textured",
        "turn_deg": 360,
        "focal_length": "known",
        "training_s": TRAINING_S,
        "region": "body crop",
        **clock.about(),
    }
    lpips = None if backbone is None else backbone.name
    rows: list[dict[str, Any]] = []
    for seed, motion in enumerate(sorted(motions.glob("*.bvh"))[:clips]):
        row = cache.measured(
            motion.stem,
            {**about, "seed": seed, "lpips": lpips},
            lambda m=motion, s=seed: _row(m, s, pose_model, backbone, clock),
        )
        rows += [] if row is None else [row]
    if rows:
        judged = [{key: row[key] for key in row.keys() - set(ORIGIN)} for row in rows]
        writer.write({**about, "mean": mean_of(judged), "rows": rows})


def render_clip(
    folder: Path, motion: Path, seed: int, rate: float = RATE, frames: int = FRAMES
) -> None:
    """Truth in `folder`/truth, footage in `folder`/raw.mp4."""
    make_sequence(
        folder / "truth",
        motion=motion,
        seed=seed,
        frames=frames,
        size=SIZE_PX,
        frames_per_second=rate,
        footage=Footage(folder / "raw.mp4", background="textured", noise=NOISE, blur_px=BLUR_PX),
    )


def truth_joints(truth: Sequence) -> Joints:
    """The true joints, as the training camera sees them."""
    extrinsics = truth.train.camera(0).world_to_camera
    return seen_joints(truth.body.skeleton, truth.motion, extrinsics)


def fit_joints(fit: Fit, times_s: Float[Array, "F"]) -> Joints:
    """The fit's joints, as the camera sees them."""
    skeleton = fit.body.skeleton
    root = fit.pelvis - skeleton.rest_joints[0]
    trust = np.ones(fit.joint_angles.shape[:2])
    motion = Motion(times_s, fit.joint_angles, root, trust)
    return seen_joints(
        skeleton, motion, np.concatenate([OPENGL_TO_OPENCV, np.zeros((3, 1))], axis=1)
    )


def mean_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Mean over clips of every number, however deep."""
    first, mean = rows[0], {}
    for key, value in first.items():
        if isinstance(value, dict):
            mean[key] = mean_of([row[key] for row in rows])
        elif isinstance(value, int | float):
            mean[key] = round(float(np.mean([row[key] for row in rows])), 3)
    return mean


def _row(
    motion: Path, seed: int, pose_model: Path, backbone: Path | None, clock: Clock
) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        render_clip(folder, motion, seed)
        return {"clip": motion.stem, **_judged(folder, pose_model, backbone, clock)}


def _judged(folder: Path, pose_model: Path, backbone: Path | None, clock: Clock) -> dict[str, Any]:
    """Capture the footage in `folder`, train on that and on the truth, evaluate both."""
    truth = open_sequence(folder / "truth")
    watch = StageWatch(truth_joints(truth), clock)
    options = CaptureOptions(
        person="captured", pose_model=pose_model, focal_px=truth.train.camera(0).focal_px
    )
    capture_clip(
        folder / "raw.mp4",
        folder / "captured",
        options,
        on_progress=watch.progress,
        on_fit=watch.fitted,
    )
    sized = StageWatch(truth_joints(truth), clock)
    with_height = replace(options, height_m=_height_m(truth))
    capture_clip(folder / "raw.mp4", folder / "sized", with_height, on_fit=sized.fitted)
    captured = open_sequence(folder / "captured")
    models = {"captured": captured, "exact": truth}
    accuracy: dict[str, Any] = {}
    for name, clip in models.items():
        model = train(clip, preset="splats", budget_s=TRAINING_S, clock=clock.now)
        if name == "captured":
            watch.refined(model, captured)
        judged = in_scale_of(captured, truth, watch.scale) if name == "captured" else truth
        for aligned in (False, True) if name == "captured" else (False,):
            figures = evaluate(model, judged, lpips_backbone=backbone, aligned=aligned)
            accuracy[f"{name}_aligned" if aligned else name] = {
                f"{measure}_{split}": round(float(figures[measure][split]["body_crop"]), 3)
                for measure in ("psnr", "ssim", "lpips")
                if figures.get(measure)
                for split in _SPLITS
                if figures[measure][split]["body_crop"] is not None
            }
    return {
        "found": len(captured.train),
        "mask_iou": round(_mask_iou(captured, truth), 4),
        "stages": watch.stages,
        "rotation_error_deg": watch.joint_rotation_errors,
        "height_known": {key: sized.stages[STAGES[-1]][key] for key in _WITH_HEIGHT},
        "accuracy": accuracy,
    }


def _height_m(truth: Sequence) -> float:
    assert truth.body.rest_vertices is not None
    return float(np.ptp(truth.body.rest_vertices[:, 1]))


class StageWatch:
    """Time of each stage of a capture, and the motion's error after it."""

    def __init__(self, truth: Joints, clock: Clock) -> None:
        self._truth, self._clock = truth, clock
        self._began, self._message = clock.now(), ""
        self._times: dict[str, float] = {}
        self.stages: dict[str, dict[str, float]] = {}
        self.joint_rotation_errors: dict[str, float] = {}
        self.scale = 1.0

    def progress(self, _: float, message: str) -> None:
        """Note when a new stage begins."""
        if message != self._message:
            self._close(self._message)
            self._message = message

    def fitted(self, stage: str, fit: Fit) -> None:
        """Evaluate the fit after `stage`."""
        self._close(stage)
        joints = fit_joints(fit, self._truth.times_s)
        errors = pose_errors(joints, self._truth)
        self.stages[stage].update({key: round(value, 3) for key, value in errors.items()})
        errors_deg = joint_rotation_errors(joints, self._truth)
        self.joint_rotation_errors = {name: round(value, 2) for name, value in errors_deg.items()}
        self.scale = gauge_scale(joints.positions, self._truth.positions)
        self._began = self._clock.now()

    def refined(self, model: PerformerModel, captured: Sequence) -> None:
        """Evaluate the motion that training refined."""
        extrinsics = captured.train.camera(0).world_to_camera
        joints = seen_joints(model.skeleton, model.motion, extrinsics)
        moments = np.abs(self._truth.times_s - joints.times_s[:, None]).argmin(axis=1)
        truth = Joints(
            joints.times_s, self._truth.positions[moments], self._truth.local_rotations[moments]
        )
        errors = pose_errors(joints, truth)
        self.stages["refined while training"] = {k: round(v, 3) for k, v in errors.items()}

    def _close(self, stage: str) -> None:
        if stage:
            spent = round(self._clock.now() - self._began, 2)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
            self.stages[stage] = {"seconds": spent, "peak_memory_mib": round(peak, 1)}
        self._began = self._clock.now()


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Frames of the truth in a world that is `scale` times as large, for a body of its own."""

    source: FrameSource
    scale: float
    rest_shift: Float[Array, "3"]
    """What the truth's rest pelvis, scaled, is above the other body's."""

    def __len__(self) -> int:
        return len(self.source)

    def camera(self, index: int) -> Camera:
        view = self.source.camera(index)
        extrinsics = view.world_to_camera.copy()
        extrinsics[:, 3] *= self.scale
        return replace(view, world_to_camera=extrinsics)

    def pose(self, index: int) -> Pose:
        pose = self.source.pose(index)
        root = self.scale * pose.root_translation + self.rest_shift
        return replace(pose, root_translation=root)

    def image(self, index: int) -> Float[Array, "H W 3"]:
        return self.source.image(index)

    def mask(self, index: int) -> Float[Array, "H W"]:
        return self.source.mask(index)


def in_scale_of(captured: Sequence, truth: Sequence, scale: float) -> Sequence:
    """The true poses and views, for a model of `captured`, whose world is the truth's / `scale`."""
    rest = [s.body.skeleton.rest_joints[0] for s in (truth, captured)]
    shift = rest[0] / scale - rest[1]

    def scaled(source: FrameSource) -> FrameSource:
        return _Scaled(source, 1.0 / scale, shift)

    tests = {split: scaled(source) for split, source in truth.test.items()}
    return replace(
        truth,
        body=captured.body,
        train=scaled(truth.train),
        test=tests,
        data_hash=captured.data_hash,
    )


def _mask_iou(captured: Sequence, truth: Sequence) -> float:
    """Mean overlap of the captured masks with the true ones, frames matched by time."""
    return float(np.mean(list(_overlaps(captured, truth))))


def _overlaps(captured: Sequence, truth: Sequence) -> Iterable[float]:
    for index, time_s in enumerate(captured.motion.times_s):
        frame = int(np.argmin(np.abs(truth.motion.times_s - time_s)))
        window, mask = captured.train.camera(index), captured.train.mask(index)
        view = truth.train.camera(frame)
        zoom = window.focal_px / view.focal_px
        x, y = (zoom * view.intrinsics[:2, 2] - window.intrinsics[:2, 2]).round().astype(int)
        # the capture's crop, filled into the truth's picture
        whole = np.zeros((round(zoom * view.height), round(zoom * view.width)), np.float32)
        whole[y : y + mask.shape[0], x : x + mask.shape[1]] = mask[
            : whole.shape[0] - y, : whole.shape[1] - x
        ]
        true = cv2.resize(truth.train.mask(frame), whole.shape[::-1], interpolation=cv2.INTER_AREA)
        a, b = whole > 0.5, true > 0.5
        yield float((a & b).sum() / max((a | b).sum(), 1))
