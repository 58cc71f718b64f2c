"""A model against the truth of its sequence's test views.

Body crop: the box of the true mask (alpha > 0) grown by 5 %. Black background, sRGB, mean over
pictures of each picture's figure, beside its spread. A test camera counts only where its side of
the body was seen in training; the others are reported apart under `unseen_side`. HumanNeRF's
protocol is the region `whole` of every 30th moment, from all cameras that training did not see.

Poses of the test views are taken as they are or, where asked, aligned by their own pictures first
(`renderer.evaluation.pose_alignment`): models of estimated poses are to be reported both ways.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from renderer.evaluation.in_motion import rendered_in
from renderer.evaluation.lpips import Lpips
from renderer.evaluation.metrics import over_black, psnr, ssim
from renderer.evaluation.other_data import on_body_of
from renderer.evaluation.pose_alignment import Aligner
from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix
from scene.sequence import (
    NOVEL_VIEW,
    UNSEEN_POSE,
    FrameSource,
    Sequence,
    body_crop,
    read_frame,
)
from scene.skeleton import Skeleton

TRAINING_VIEW = "training_view"
OTHER_DATA = "other_data"
"""Frames of data that the model was not trained on."""
REGIONS = ("body_crop", "whole")
MEASURES = ("psnr", "ssim", "lpips")
SEEN_WITHIN_DEG = 30.0
"""A side counts as seen when a training camera stood within this angle round the body."""
HUMANNERF_EVERY = 30
"""HumanNeRF's protocol judges one moment in so many."""
_TRAINING_VIEWS = 8
_SMALLEST_CROP_PX = 32
_MODEL_METRICS = (
    "steps",
    "train_seconds",
    "published_iterations",
    "schedule_scale",
    "rays_a_step",
    "samples_a_ray",
    "perceptual_loss",
    "scaled",
    "size",
)
"""What a model's training tells that its figures can't be read without."""


@dataclass(frozen=True, eq=False)
class EvaluatedView:
    """One picture and its truth."""

    split: str
    index: int
    truth: Float[Array, "H W 3"]
    """sRGB over black."""
    made: Float[Array, "H W 3"]
    crop: tuple[slice, slice] | None
    """Rows and columns of the body; None where nobody is in the picture."""


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """What every picture is measured with."""

    model: PerformerModel
    skeleton: Skeleton
    seen: Float[Array, "F"]
    """Sides of the body that training saw, rad."""
    lpips: Lpips | None
    on_view: Callable[[EvaluatedView], None]


def evaluate(
    model: PerformerModel,
    sequence: Sequence,
    lpips_backbone: Path | None = None,
    *,
    aligned: bool = False,
    every: int = 1,
    on_view: Callable[[EvaluatedView], None] = lambda _: None,
) -> dict[str, Any]:
    """PSNR (dB), SSIM and LPIPS of `model` on the test views of `sequence`, and on training views.

    Returns {measure: {split: {region: mean}}} for the measures `psnr`, `ssim`, `lpips`, the splits
    `novel_view`, `unseen_pose`, `training_view` (a few training frames in the model's own, perhaps
    refined, poses) and the regions `body_crop`, `whole`. Of data that the model was not trained on
    the last split is `other_data`: a few of its frames, in that data's poses. A mean is None where
    nothing was measured: a clip without test views, or LPIPS without a backbone. `spread` holds the
    standard deviations over pictures in the same shape, `unseen_side` the means for cameras that
    saw a side no training camera saw, `per_view` each picture's own figures, `per_frame` the means
    of each moment's views, `conditions` how all this was measured.

    Args:
        aligned: first align each test pose with its own picture; `conditions` says so. What is
            then measured is the model without the offset of its canonical body.
        every: judge one moment in so many of each split (HumanNeRF's protocol: 30), training
            frames alike. With 1, all test views and a few training frames.
        on_view: called with every picture as it is evaluated.

    Raises InvalidInput for data of another person (`other_data.size_ratio`).
    """
    trained_on = sequence.data_hash == model.data_hash
    skeleton = sequence.body.skeleton if trained_on else model.skeleton
    if not trained_on:
        sequence = on_body_of(model, sequence)
    aligner = Aligner(model, sequence) if aligned else None
    evaluation = _Evaluation(
        model,
        skeleton,
        _sides(sequence.train, skeleton),
        None if lpips_backbone is None else Lpips(lpips_backbone),
        on_view,
    )
    rate, train = sequence.frames_per_second, sequence.train
    per_view: dict[str, list[dict[str, Any]]] = {}
    for split in (NOVEL_VIEW, UNSEEN_POSE):
        source = sequence.test.get(split)
        per_view[split] = (
            []
            if source is None
            else [
                _measure(
                    evaluation,
                    split,
                    source,
                    index,
                    _test_pose(source, index, aligner, _motion_of(model, split)),
                )
                for index in _frames_every(source, every, rate)
            ]
        )
    frames = _frames_every(train, every, rate) if every > 1 else _spread_frames(len(train))
    if trained_on:
        per_view[TRAINING_VIEW] = [
            _measure(
                evaluation, TRAINING_VIEW, train, i, model.motion.pose_at(train.pose(i).time_s)
            )
            for i in frames
        ]
    else:
        per_view[OTHER_DATA] = [
            _measure(evaluation, OTHER_DATA, train, i, _test_pose(train, i, aligner))
            for i in frames
        ]
    return {
        **_summary(per_view, _mean, seen_side=True),
        "spread": _summary(per_view, _spread, seen_side=True),
        "unseen_side": _summary(per_view, _mean, seen_side=False),
        "per_frame": {split: _per_frame(views) for split, views in per_view.items()},
        "per_view": per_view,
        "conditions": {
            **_conditions(evaluation, sequence, aligned=aligned, every=every),
            "trained_on_this_data": trained_on,
        },
    }


def _conditions(
    evaluation: _Evaluation, sequence: Sequence, *, aligned: bool, every: int
) -> dict[str, Any]:
    lpips, model = evaluation.lpips, evaluation.model
    model_metrics = {name: model.metrics[name] for name in _MODEL_METRICS if name in model.metrics}
    return {
        "model": {"preset": model.preset, **model_metrics},
        "resolution": _resolutions(sequence),
        "background": "black",
        "colour": "sRGB in [0, 1]",
        "every": every,
        "test_poses": "aligned with their own pictures" if aligned else "as given",
        "body_crop": "box of the true mask (alpha > 0) grown by 5 %",
        "seen_within_deg": SEEN_WITHIN_DEG,
        "lpips": None
        if lpips is None
        else {
            "backbone": lpips.backbone,
            "linear_layers": "0.1",
            "input_range": [-1, 1],
        },
    }


def side_of_body(camera: Camera, pose: Pose, skeleton: Skeleton) -> float:
    """Where `camera` stands round the body: 0 in front, +pi/2 at the person's left, rad."""
    pelvis = skeleton.rest_joints[0] + pose.root_translation
    facing = axis_angle_to_matrix(pose.joint_angles[0])
    towards = facing.T @ (camera.position - pelvis)
    return float(np.arctan2(towards[0], towards[2]))


def _sides(source: FrameSource, skeleton: Skeleton) -> Float[Array, "F"]:
    indices = range(len(source))
    return np.array([side_of_body(source.camera(i), source.pose(i), skeleton) for i in indices])


def _spread_frames(frames: int) -> list[int]:
    picked = np.linspace(0, frames - 1, min(frames, _TRAINING_VIEWS)).round().astype(int)
    return np.unique(picked).tolist()


def _frames_every(source: FrameSource, every: int, frames_per_second: float) -> list[int]:
    """The views of one moment in `every`, counted from the source's first."""
    times = np.array([source.pose(index).time_s for index in range(len(source))])
    numbers = np.round((times - times.min(initial=np.inf)) * frames_per_second).astype(int)
    return np.flatnonzero(numbers % every == 0).tolist()


def _test_pose(
    source: FrameSource, index: int, aligner: Aligner | None, motion: Motion | None = None
) -> Pose:
    if aligner is None:
        return source.pose(index)
    return aligner.align(read_frame(source, index), motion)


def _motion_of(model: PerformerModel, split: str) -> Motion | None:
    """That frames of `split` are moments of, if they are of the clip."""
    return model.motion if split in (NOVEL_VIEW, TRAINING_VIEW) else None


def _measure(
    evaluation: _Evaluation, split: str, source: FrameSource, index: int, pose: Pose
) -> dict[str, Any]:
    """One picture's figures."""
    camera, mask = source.camera(index), source.mask(index)
    truth = over_black(source.image(index), mask)
    motion = _motion_of(evaluation.model, split)
    made = np.clip(rendered_in(evaluation.model, camera, pose, motion)[..., :3], 0.0, 1.0)
    given = source.pose(index)
    side = side_of_body(camera, given, evaluation.skeleton)
    nearest = np.abs((evaluation.seen - side + np.pi) % (2.0 * np.pi) - np.pi).min()
    figures: dict[str, Any] = {
        "index": index,
        "time_s": round(given.time_s, 4),
        "side_deg": round(float(np.degrees(side)), 1),
        "seen_side": bool(nearest <= np.radians(SEEN_WITHIN_DEG)),
    }
    crop = body_crop(mask)
    evaluation.on_view(EvaluatedView(split, index, truth, made, crop))
    for region, window in zip(REGIONS, (crop, (slice(None), slice(None))), strict=True):
        if window is None:
            continue
        one, other = made[window], truth[window]
        figures[region] = {
            # capped where pictures are equal, so that a mean exists and JSON can hold it
            "psnr": min(psnr(one, other), 100.0),
            "ssim": ssim(one, other) if min(one.shape[:2]) >= _SMALLEST_CROP_PX else None,
            "lpips": _distance(evaluation.lpips, one, other),
        }
    return figures


@torch.no_grad()
def _distance(
    lpips: Lpips | None, made: Float[Array, "H W 3"], truth: Float[Array, "H W 3"]
) -> float | None:
    if lpips is None or min(made.shape[:2]) < _SMALLEST_CROP_PX:
        return None
    pair = [
        torch.from_numpy(np.ascontiguousarray(picture, np.float32)).movedim(-1, 0)[None]
        for picture in (made, truth)
    ]
    return float(lpips(*pair)[0])


def _summary(
    per_view: dict[str, list[dict[str, Any]]],
    over: Callable[[Iterable[float | None]], float | None],
    *,
    seen_side: bool,
) -> dict[str, Any]:
    return {
        measure: {
            split: {
                region: over(
                    view[region][measure]
                    for view in views
                    if region in view and view["seen_side"] is seen_side
                )
                for region in REGIONS
            }
            for split, views in per_view.items()
        }
        for measure in MEASURES
    }


def _per_frame(views: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means of each moment's views, whichever side they saw."""
    times = sorted({view["time_s"] for view in views})
    by_time = {time_s: [v for v in views if v["time_s"] == time_s] for time_s in times}
    return [
        {"time_s": time_s, "views": len(frame_views)}
        | {
            region: {m: _mean(v[region][m] for v in frame_views if region in v) for m in MEASURES}
            for region in REGIONS
        }
        for time_s, frame_views in by_time.items()
    ]


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return round(float(np.mean(known)), 5) if known else None


def _spread(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return round(float(np.std(known)), 5) if known else None


def _resolutions(sequence: Sequence) -> dict[str, list[int]]:
    sources = {**sequence.test, TRAINING_VIEW: sequence.train}
    return {
        split: [source.camera(0).width, source.camera(0).height]
        for split, source in sources.items()
        if len(source)
    }
