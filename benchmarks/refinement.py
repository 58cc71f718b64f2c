"""Noise on every joint of a studio clip: what each way of refining poses wins back.

`splats` refine poses as they train, `fast` by the paper's own MLP; each beside the same preset that
believes the poses it is given.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.pose_errors import geodesic_deg
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import Clock, clock_named
from capture.storage import open_sequence
from capture.studio import make_sequence
from renderer.evaluation.evaluate import evaluate
from renderer.training import train
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import NOVEL_VIEW, FrameSource, PoseTrust, Sequence

NOISE = ((2.0, False), (5.0, True))
"""Standard deviation about each axis of each joint, degrees, and whether it lasts: independent from
frame to frame, or wandering as a real capture's does."""
CORRELATION_S, SHIFT_M = 0.5, 0.03
"""Of noise that lasts: for how long, and how far the root then wanders."""
BUDGETS_S = {"splats": 20.0, "fast": 60.0}
_ALIGNED_EVERY = 8
"""Aligned figures are the mean over every eighth test view."""


class _Chosen:
    """Some frames of a source, with the poses that `motion` claims where it is given."""

    def __init__(self, source: FrameSource, frames: range, motion: Motion | None = None) -> None:
        self._source, self._frames, self._motion = source, frames, motion

    def __len__(self) -> int:
        return len(self._frames)

    def camera(self, index: int) -> Camera:
        return self._source.camera(self._frames[index])

    def pose(self, index: int) -> Pose:
        frame = self._frames[index]
        return self._source.pose(frame) if self._motion is None else self._motion.pose(frame)

    def image(self, index: int) -> Float[Array, "H W 3"]:
        return self._source.image(self._frames[index])

    def mask(self, index: int) -> Float[Array, "H W"]:
        return self._source.mask(self._frames[index])


def run(writer: FigureWriter, clock_name: str) -> None:
    """Measure and report."""
    clock, rows = clock_named(clock_name), []
    with tempfile.TemporaryDirectory() as folder:
        make_sequence(Path(folder) / "sequence")
        clip = open_sequence(Path(folder) / "sequence")
        for noise_deg, lasting in NOISE:
            noisy = with_noise(clip, noise_deg, lasting=lasting)
            for preset, refined in product(BUDGETS_S, (False, True)):
                about = {"noise_deg": noise_deg, "lasting": lasting, "refined": refined}
                rows.append({**about, **_row(clip, noisy, preset, clock, refined=refined)})
                print(rows[-1], flush=True)
    about = {
        "frames": 60,
        "size": 256,
        "look": "plain",
        "region": "body crop",
        "budgets_s": BUDGETS_S,
        "correlation_s": CORRELATION_S,
        "shift_m": SHIFT_M,
        "aligned_every": _ALIGNED_EVERY,
        **clock.about(),
    }
    writer.write({**about, "rows": rows})


def with_noise(clip: Sequence, noise_deg: float, *, lasting: bool) -> Sequence:
    """`clip` as if its poses had been estimated, with that much noise."""
    rng, motion = np.random.default_rng(0), clip.motion
    noise, shift = rng.normal(size=motion.joint_angles.shape), np.zeros((len(motion), 3))
    if lasting:
        gap = motion.times_s[:, None] - motion.times_s[None, :]
        kernel = np.exp(-0.5 * (gap / CORRELATION_S) ** 2)
        kernel /= np.sqrt((kernel**2).sum(axis=1, keepdims=True))
        noise = np.einsum("fg,gkx->fkx", kernel, noise)
        shift = SHIFT_M * kernel @ rng.normal(size=shift.shape)
    rotations = axis_angle_to_matrix(np.deg2rad(noise_deg) * noise)
    claimed = replace(
        motion,
        joint_angles=matrix_to_axis_angle(rotations @ axis_angle_to_matrix(motion.joint_angles)),
        root_translation=motion.root_translation + shift,
    )
    train = _Chosen(clip.train, range(len(clip.train)), claimed)
    return replace(clip, train=train, motion=claimed, pose_trust=PoseTrust.ESTIMATED)


def _row(
    clip: Sequence, noisy: Sequence, preset: str, clock: Clock, *, refined: bool
) -> dict[str, Any]:
    trust = PoseTrust.ESTIMATED if refined else PoseTrust.EXACT  # exact ones are believed
    given = replace(noisy, pose_trust=trust)
    model = train(given, preset=preset, budget_s=BUDGETS_S[preset], clock=clock.now)
    views = clip.test[NOVEL_VIEW]
    few = _Chosen(views, range(0, len(views), _ALIGNED_EVERY))
    as_given = evaluate(model, replace(clip, test={NOVEL_VIEW: views}))
    aligned = evaluate(model, replace(clip, test={NOVEL_VIEW: few}), aligned=True)
    return {
        "preset": preset,
        "steps": model.metrics["steps"],
        "psnr_novel_view": as_given["psnr"][NOVEL_VIEW]["body_crop"],
        "psnr_novel_view_aligned": aligned["psnr"][NOVEL_VIEW]["body_crop"],
        "psnr_training_view": as_given["psnr"]["training_view"]["body_crop"],
        "rotation_error_deg_before": rotation_error_deg(noisy.motion, clip.motion),
        "rotation_error_deg": rotation_error_deg(model.motion, clip.motion),
        "joint_mm_before": _joint_mm(noisy.motion, clip),
        "joint_mm": _joint_mm(model.motion, clip),
    }


def rotation_error_deg(motion: Motion, truth: Motion) -> float:
    """Mean error of the joints' own rotations."""
    one, other = (axis_angle_to_matrix(m.joint_angles) for m in (motion, truth))
    return round(float(geodesic_deg(one, other).mean()), 3)


def _joint_mm(motion: Motion, clip: Sequence) -> float:
    """Mean error of the joints' positions."""
    positions = [
        clip.body.skeleton.joint_transforms(m.joint_angles, m.root_translation)[..., :3, 3]
        for m in (motion, clip.motion)
    ]
    return round(1e3 * float(np.linalg.norm(positions[0] - positions[1], axis=-1).mean()), 2)
