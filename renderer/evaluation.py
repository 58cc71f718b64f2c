"""A model against the truth of its sequence's test views.

Body crop: the box of the true mask (alpha > 0) grown by 5 %. Black background, sRGB, mean over
pictures of each picture's figure. A test camera counts only where its side of the body was seen in
training; the others are reported apart under `unseen_side`.

Poses of the test views are taken as they are or, where asked, aligned by their own pictures first
(`renderer.alignment`): models of estimated poses are to be reported both ways.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from renderer.alignment import Aligner
from renderer.lpips import Lpips
from renderer.metrics import over_black, psnr, ssim
from renderer.model import PersonModel
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Pose
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
REGIONS = ("body_crop", "whole")
MEASURES = ("psnr", "ssim", "lpips")
SEEN_WITHIN_DEG = 30.0
"""A side counts as seen when a training camera stood within this angle round the body."""
_TRAINING_VIEWS = 8
_SMALLEST_CROP_PX = 32


def evaluate(
    model: PersonModel,
    sequence: Sequence,
    lpips_backbone: Path | None = None,
    *,
    aligned: bool = False,
) -> dict[str, Any]:
    """PSNR (dB), SSIM and LPIPS of `model` on the test views of `sequence`, and on training views.

    Returns {measure: {split: {region: mean}}} for the measures `psnr`, `ssim`, `lpips`, the splits
    `novel_view`, `unseen_pose`, `training_view` (a few training frames in the model's own, perhaps
    refined, poses) and the regions `body_crop`, `whole`. A mean is None where nothing was measured:
    a clip without test views, or LPIPS without a backbone. `unseen_side` holds the same for cameras
    that saw a side no training camera saw, `per_view` each picture's own figures, `conditions` how
    all this was measured.

    With `aligned`, each test pose is first aligned with its own picture, and `conditions` says so:
    what is then measured is the model without the offset of its canonical body.
    """
    aligner = Aligner(model, sequence) if aligned else None
    lpips = None if lpips_backbone is None else Lpips(lpips_backbone)
    seen = _sides(sequence.train, sequence.body.skeleton)
    per_view: dict[str, list[dict[str, Any]]] = {}
    for split in (NOVEL_VIEW, UNSEEN_POSE):
        source = sequence.test.get(split)
        per_view[split] = [] if source is None else [
            _measure(model, source, index, _test_pose(source, index, aligner), seen,
                     sequence.body.skeleton, lpips)
            for index in range(len(source))
        ]  # fmt: skip
    per_view[TRAINING_VIEW] = [
        _measure(model, sequence.train, index, model.motion.pose_at(pose.time_s), seen,
                 sequence.body.skeleton, lpips)
        for index, pose in _some_training_poses(sequence)
    ]  # fmt: skip
    return {
        **_summary(per_view, seen_side=True),
        "unseen_side": _summary(per_view, seen_side=False),
        "per_view": per_view,
        "conditions": {
            "resolution": _resolutions(sequence),
            "background": "black",
            "colour": "sRGB in [0, 1]",
            "test_poses": "aligned with their own pictures" if aligned else "as given",
            "body_crop": "box of the true mask (alpha > 0) grown by 5 %",
            "seen_within_deg": SEEN_WITHIN_DEG,
            "lpips": None if lpips is None else {
                "backbone": lpips.backbone, "linear_layers": "0.1", "input_range": [-1, 1],
            },
        },
    }  # fmt: skip


def side_of_body(camera: Camera, pose: Pose, skeleton: Skeleton) -> float:
    """Where `camera` stands round the body: 0 in front, +pi/2 at the person's left, rad."""
    pelvis = skeleton.rest_joints[0] + pose.root_translation
    facing = axis_angle_to_matrix(pose.joint_angles[0])
    towards = facing.T @ (camera.position - pelvis)
    return float(np.arctan2(towards[0], towards[2]))


def _sides(source: FrameSource, skeleton: Skeleton) -> Float[Array, "F"]:
    indices = range(len(source))
    return np.array([side_of_body(source.camera(i), source.pose(i), skeleton) for i in indices])


def _some_training_poses(sequence: Sequence) -> list[tuple[int, Pose]]:
    frames = len(sequence.train)
    picked = np.unique(np.linspace(0, frames - 1, min(frames, _TRAINING_VIEWS)).round().astype(int))
    return [(int(index), sequence.train.pose(int(index))) for index in picked]


def _test_pose(source: FrameSource, index: int, aligner: Aligner | None) -> Pose:
    return source.pose(index) if aligner is None else aligner.align(read_frame(source, index))


def _measure(
    model: PersonModel, source: FrameSource, index: int, pose: Pose, seen: Float[Array, "F"],
    skeleton: Skeleton, lpips: Lpips | None,
) -> dict[str, Any]:  # fmt: skip
    """One picture's figures."""
    camera, mask = source.camera(index), source.mask(index)
    truth = over_black(source.image(index), mask)
    made = np.clip(model.render(camera, pose)[..., :3], 0.0, 1.0)
    side = side_of_body(camera, source.pose(index), skeleton)
    nearest = np.abs((seen - side + np.pi) % (2.0 * np.pi) - np.pi).min()
    figures: dict[str, Any] = {
        "index": index,
        "side_deg": round(float(np.degrees(side)), 1),
        "seen_side": bool(nearest <= np.radians(SEEN_WITHIN_DEG)),
    }
    crop = body_crop(mask)
    for region, window in zip(REGIONS, (crop, (slice(None), slice(None))), strict=True):
        if window is None:
            continue
        one, other = made[window], truth[window]
        figures[region] = {
            # capped where pictures are equal, so that a mean exists and JSON can hold it
            "psnr": min(psnr(one, other), 100.0),
            "ssim": ssim(one, other) if min(one.shape[:2]) >= _SMALLEST_CROP_PX else None,
            "lpips": _distance(lpips, one, other),
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


def _summary(per_view: dict[str, list[dict[str, Any]]], *, seen_side: bool) -> dict[str, Any]:
    return {
        measure: {
            split: {
                region: _mean(
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


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return round(float(np.mean(known)), 5) if known else None


def _resolutions(sequence: Sequence) -> dict[str, list[int]]:
    sources = {**sequence.test, TRAINING_VIEW: sequence.train}
    return {
        split: [source.camera(0).width, source.camera(0).height]
        for split, source in sources.items()
        if len(source)
    }
