"""A model against clean frames: figures, the worst picture, and whether there is one at all."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from benchmarks.stability.material import Material
from benchmarks.stability.poses import joint_mm, rotation_deg
from renderer.evaluation.in_motion import rendered_in
from renderer.evaluation.lpips import Lpips
from renderer.evaluation.metrics import psnr
from renderer.evaluation.pose_alignment import Aligner
from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float
from scene.errors import SceneError
from scene.motion import Motion, Pose
from scene.sequence import Frame, PoseTrust, body_crop

MEASURED, REFUSED, FAILED = "measured", "refused", "failed"
"""Outcomes: figures; a refusal in words, of the kind that users see; anything else."""
_EMPTY = 0.02
"""A picture with less than this share of the person's alpha is empty."""
_LPIPS_LEAST_PX = 32
_MOST_DB = 100.0


class NoPicture(Exception):
    """A model rendered nothing, or something that is no number."""


@dataclass(frozen=True, eq=False)
class JudgedPicture:
    """A picture and its truth, cut to the person, over black."""

    truth: Float[Array, "h w 3"]
    rendered: Float[Array, "h w 3"]

    @property
    def decibels(self) -> float:
        """PSNR, capped where pictures are equal."""
        return min(psnr(self.rendered, self.truth), _MOST_DB)


def guarded(measure: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What `measure` finds, or what its error comes to: our own tell users what to do, others must
    not happen."""
    try:
        return {"outcome": MEASURED, **measure()}
    except Exception as error:  # a crash is what is looked for
        outcome = REFUSED if isinstance(error, SceneError) else FAILED
        return {"outcome": outcome, "why": f"{type(error).__name__}: {error}"}


def shown(
    model: PerformerModel, frame: Frame, pose: Pose, motion: Motion | None = None
) -> JudgedPicture:
    """`model` in `pose`, a moment of `motion`, beside `frame`. Raises NoPicture."""
    rendered = rendered_in(model, frame.camera, pose, motion)
    if not np.isfinite(rendered).all():
        raise NoPicture("a rendered picture must be finite; got NaN or infinity")
    if rendered[..., 3].sum() < _EMPTY * frame.mask.sum():
        raise NoPicture("a rendered picture must show the person; got an empty one")
    crop = body_crop(frame.mask) or (slice(None), slice(None))
    return JudgedPicture(frame.image[crop], np.clip(rendered[..., :3], 0.0, 1.0)[crop])


def figures(
    model: PerformerModel, material: Material, lpips: Lpips, *, aligned: bool
) -> tuple[dict[str, Any], JudgedPicture]:
    """Means over the judged frames, and the worst of them.

    Args:
        aligned: `psnr` and `lpips` are of test poses aligned with their own pictures first;
            `psnr_as_given` is of poses as they are.

    Raises NoPicture.
    """
    truth = material.true_motion
    given = [shown(model, frame, frame.pose, truth) for frame in material.judged]
    views = given
    if aligned:
        aligner = Aligner(model, material.sequence(PoseTrust.ESTIMATED))
        views = [
            shown(model, frame, aligner.align(frame, truth), truth) for frame in material.judged
        ]
    worst = min(views, key=lambda one: one.decibels)
    skeleton = material.body.skeleton
    trained = material.sequence(PoseTrust.ESTIMATED).motion
    found = {
        "psnr": mean(one.decibels for one in views),
        "lpips": mean(distance(lpips, one) for one in views),
        "psnr_as_given": mean(one.decibels for one in given),
        "psnr_worst_view": worst.decibels,
        "flicker": flicker(model, material.successive, truth),
        "joint_mm_given": joint_mm(trained, skeleton, truth, skeleton),
        "joint_mm": joint_mm(model.motion, model.skeleton, truth, skeleton),
        "rotation_deg_given": rotation_deg(trained, truth),
        "rotation_deg": rotation_deg(model.motion, truth),
    }
    rounded = {name: None if value is None else round(value, 4) for name, value in found.items()}
    of_training = ("steps", "rollbacks", "rollback_seconds")
    return {**rounded, **{name: model.metrics[name] for name in of_training}}, worst


@torch.no_grad()
def distance(lpips: Lpips, one: JudgedPicture) -> float | None:
    """LPIPS of a picture; None where it is too small."""
    if min(one.truth.shape[:2]) < _LPIPS_LEAST_PX:
        return None
    pair = [
        torch.from_numpy(np.ascontiguousarray(picture, np.float32)).movedim(-1, 0)[None]
        for picture in (one.rendered, one.truth)
    ]
    return float(lpips(*pair)[0])


def flicker(
    model: PerformerModel,
    successive: Iterable[tuple[Frame, Frame]],
    motion: Motion | None = None,
) -> float | None:
    """How much pictures change from a frame to the next, over the person in either, as a multiple
    of how much the truth does; frames are moments of `motion`. Raises NoPicture."""
    found = []
    for pair in successive:
        rows = min(frame.camera.height for frame in pair)  # where pictures end at the waist
        person = (pair[0].mask[:rows] > 0.5) | (pair[1].mask[:rows] > 0.5)
        if not person.any():
            continue
        rendered = [
            rendered_in(model, frame.camera, frame.pose, motion)[:rows, :, :3].copy()
            for frame in pair
        ]
        changes = [
            float(np.abs(late - early)[person].mean())
            for early, late in (rendered, [frame.image[:rows] for frame in pair])
        ]
        found.append(changes[0] / max(changes[1], 1e-4))
    return mean(found)


def mean(values: Iterable[float | None]) -> float | None:
    """Of those that there are; None without any."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
