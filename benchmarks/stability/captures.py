"""Axes of a capture from pixels alone: the footage, the landmarks or the masks are disturbed.

One performance in a room, through a lens and a sensor. The clip is captured as the product does it;
the fitted joints are held against the truth, and a model of the capture is judged as any other,
each test pose aligned with its own picture and one scale for the clip taken out.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.capture import StageWatch, in_scale_of, truth_joints
from benchmarks.reporting.timing import Clock
from benchmarks.stability.axis import Axis
from benchmarks.stability.footage import (
    NOISE,
    RENDERED_RATE,
    Degraded,
    Variant,
    cut,
    darkened,
    dropped,
    exchanged,
    holed,
    outlined,
    passed_by,
    rolled,
    shrunk,
)
from benchmarks.stability.material import Material, frames_of, spread
from benchmarks.stability.pictures import CROPS, ended_at
from benchmarks.stability.pose_errors import Joints
from benchmarks.stability.trainings import Method, measure_training
from capture.detection.landmarks import PoseEstimator
from capture.detection.lifter import lift
from capture.fitting.fit import STAGES
from capture.overlay import write_video
from capture.pipeline import CaptureOptions, capture_clip
from capture.sources.video import read_video
from capture.storage import open_sequence
from capture.studio.footage import Footage
from capture.studio.sequence import make_sequence
from renderer.evaluation.lpips import Lpips
from scene.sequence import NOVEL_VIEW, Frame, FrameSource, Sequence

CAPTURE = "capture from pixels"
CLIP = "walk_veer_left_16_11"
_FRAMES, _SIZE_PX, _STORED_PX = 120, 384, 256
_BLUR_PX, _SEED, _JUDGED, _PAIRS = 0.6, 7, 8, 6
_FIGURES = (
    "joint_one_scale_mm",
    "joint_procrustes_mm",
    "rotation_error_deg",
    "root_one_scale_mm",
    "scale",
    "swapped_frames",
)
"""Of the last stage of the fit, as `bench capture` has them."""
_AGAINST_ITSELF = ("joint_mm_given", "joint_mm", "rotation_deg_given", "rotation_deg")


@dataclass(frozen=True)
class CaptureAxis(Axis):
    """Disturbs what a capture gets."""

    variant: Callable[[float], Variant] = field(kw_only=True)
    cut_too: bool = field(default=False, kw_only=True)
    """What is judged ends where the footage does."""


CAPTURE_AXES = (
    CaptureAxis("landmarks_dropped", "landmarks dropped", CAPTURE,
                (0.0, 0.1, 0.3, 0.5, 0.7), " of them",
                variant=lambda share: Variant(degrade=dropped(share))),
    CaptureAxis("landmarks_exchanged", "left and right exchanged", CAPTURE,
                (0.0, 0.05, 0.15, 0.3), " of frames",
                variant=lambda share: Variant(degrade=exchanged(share))),
    CaptureAxis("estimator_holes", "holes in the estimator's masks", CAPTURE,
                (0.0, 2.0, 4.0, 8.0), variant=lambda count: Variant(degrade=holed(count))),
    CaptureAxis("estimator_wide", "the estimator's masks too wide", CAPTURE,
                (0.0, 1.0, 2.0, 4.0, 8.0), " px", variant=lambda px: Variant(degrade=outlined(px))),
    CaptureAxis("estimator_narrow", "the estimator's masks too narrow", CAPTURE,
                (0.0, -1.0, -2.0, -4.0, -8.0), " px",
                variant=lambda px: Variant(degrade=outlined(px))),
    CaptureAxis("focal_unknown", "focal length", CAPTURE, (0.0, 1.0),
                labels=("known", "unknown"),
                variant=lambda step: Variant(focal_known=not step)),
    CaptureAxis("passer_by", "somebody passes behind", CAPTURE, (0.0, 1.0), labels=("no", "yes"),
                variant=lambda step: Variant(pictures=passed_by) if step else Variant()),
    CaptureAxis("footage_size", "footage size, of 384 px", CAPTURE, (1.0, 0.5, 0.25, 0.125),
                " of it", variant=lambda share: Variant(pictures=shrunk(share))),
    CaptureAxis("footage_rate", "frames a second", CAPTURE, (15.0, 10.0, 5.0, 3.0, 1.0),
                variant=lambda rate: Variant(rate=rate)),
    CaptureAxis("footage_rate_high", "frames a second, more", CAPTURE, (15.0, 30.0),
                variant=lambda rate: Variant(rate=rate)),
    CaptureAxis("footage_dark", "less light, no gain", CAPTURE, (0.0, 2.0, 4.0, 6.0), " stops",
                variant=lambda stops: Variant(pictures=darkened(stops))),
    CaptureAxis("footage_roll", "footage rolls to and fro", CAPTURE, (0.0, 2.0, 5.0, 10.0, 20.0),
                "°", variant=lambda degrees: Variant(pictures=rolled(degrees))),
    CaptureAxis("footage_cut", "footage ends at", CAPTURE, (0.0, 1.0, 2.0, 3.0), labels=CROPS,
                variant=lambda step: Variant(pictures=cut(step)), cut_too=True),
)  # fmt: skip


@dataclass(frozen=True)
class CaptureBench:
    """What every capture is measured with."""

    folder: Path
    """Of the footage and its truth."""
    estimator: PoseEstimator
    method: Method
    lpips: Lpips
    clock: Clock

    def render(self, motions: Path) -> None:
        """Truth in `folder`/truth, footage in `folder`/raw.mp4; once."""
        if (self.folder / "truth").exists():
            return
        raw = self.folder / "raw.mp4"
        raw.unlink(missing_ok=True)
        make_sequence(
            self.folder / "truth",
            motion=motions / f"{CLIP}.bvh",
            seed=_SEED,
            frames=_FRAMES,
            size=_SIZE_PX,
            frames_per_second=RENDERED_RATE,
            footage=Footage(raw, background="textured", noise=NOISE, blur_px=_BLUR_PX),
        )

    def measure(self, axis: CaptureAxis, step: float, strip: Path) -> dict[str, Any]:
        """The outcome and figures of one capture, and of a model of it."""
        errors: dict[str, float] = {}

        def material() -> Material:
            with tempfile.TemporaryDirectory() as name:
                captured, scale = self._capture(axis.variant(step), Path(name), errors)
                truth = open_sequence(self.folder / "truth")
                return by_the_truth(captured, truth, scale, CROPS[int(step) if axis.cut_too else 0])

        found = measure_training(self.method, material, self.lpips, self.clock.now, strip)
        # the captured motion was taken for the truth there
        told = {name: value for name, value in found.items() if name not in _AGAINST_ITSELF}
        return {**told, **errors}

    def _capture(
        self, variant: Variant, folder: Path, errors: dict[str, float]
    ) -> tuple[Sequence, float]:
        """The captured clip and its scale to the truth; `errors` are filled with those of its
        joints."""
        truth = open_sequence(self.folder / "truth")
        step = round(RENDERED_RATE / variant.rate)
        images = read_video(self.folder / "raw.mp4", max_frames=_FRAMES).images[::step]
        images = variant.pictures(truth, images)
        write_video(images, folder / "clip.mp4", variant.rate)
        joints = truth_joints(truth)
        thinned = Joints(
            joints.times_s[::step], joints.positions[::step], joints.local_rotations[::step]
        )
        watch = StageWatch(thinned, self.clock)
        degrade = variant.degrade
        view = truth.train.camera(0)
        options = CaptureOptions(
            person="somebody",
            estimator=self.estimator if degrade is None else Degraded(self.estimator, degrade),
            lifter=lift,
            size_px=_STORED_PX,
            focal_px=view.focal_px * images[0].shape[1] / view.width
            if variant.focal_known
            else None,
        )
        capture_clip(folder / "clip.mp4", folder / "clip", options, on_fit=watch.fitted)
        last = watch.stages[STAGES[-1]]
        errors.update({name: last[name] for name in _FIGURES})
        return open_sequence(folder / "clip"), watch.scale


def by_the_truth(captured: Sequence, truth: Sequence, scale: float, ends_at: str) -> Material:
    """What a model of `captured` trains on, and is judged by in the captured world, whose truth is
    `scale` times as large.

    Args:
        ends_at: how far down of a picture is judged, of `CROPS`.
    """
    truth = in_scale_of(captured, truth, scale)
    views, filmed = truth.test[NOVEL_VIEW], truth.train

    def seen(source: FrameSource, places: Iterable[int]) -> tuple[Frame, ...]:
        frames = frames_of(source, places)
        return tuple(ended_at(frame, captured.body.skeleton, ends_at) for frame in frames)

    early = spread(len(filmed) - 1, _PAIRS)
    late = [place + 1 for place in early]
    return Material(
        captured.body,
        captured.frames_per_second,
        frames_of(captured.train, range(len(captured.train))),
        seen(views, spread(len(views), _JUDGED)),
        tuple(zip(seen(filmed, early), seen(filmed, late), strict=True)),
        captured.motion,
    )
