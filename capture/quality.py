"""Quality report of a capture: measured before training, with advice on what to record again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from capture.captured import CapturedClip
from capture.overlay import project_surface
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix

SIDES = ("front", "left", "back", "right")
"""Sides of the person, each a quarter turn: the front faces the camera within 45 degrees."""
_SIDE_SEEN = 0.08
_SHARP = 40.0
"""Variance of the Laplacian (grey levels squared) of a usable picture of 512 px."""
_GOOD_ERROR = 0.02
_GOOD_IOU = 0.75
_SMALL_PX = 160
_CHECKED_FRAMES = 12
_WEAK = 0.7
"""A frame is weak below this share of the clip's usual confidence,"""
_WEAK_ERROR = 2.5
"""or beyond so many times its usual distance from the landmarks."""
_WEAK_S = 0.25
"""Shorter spans of weak frames are not reported."""


@dataclass(frozen=True)
class CaptureQuality:
    """The report; every share is 0 to 1."""

    frames_used: int
    frames_lost: int
    """Sampled frames in which the person was not found."""
    takes: int
    """Runs of frames without a jump of the picture."""
    recordings: int
    """Of which the clip is made: so many takes are no fault of it."""
    coverage: Mapping[str, float]
    """Share of frames that show each side."""
    landmark_error_px: float
    """Mean distance of seen landmarks from the fitted body's, px of the clip that was judged: as
    many as it would be at the clip's usual distance, since somebody who comes close is larger."""
    landmark_error: float
    """The same in heights of the person's box."""
    landmark_error_mm: float
    """The same at the person's distance, mm."""
    joints_in_mask: float
    """Share of seen joints that fall on the mask."""
    mask_overlap: float
    """Intersection over union of the mask and the projected surface."""
    confidence: float
    """Mean visibility of the joints."""
    frame_confidence: tuple[float, ...]
    """The same for each stored frame."""
    weak_s: tuple[tuple[float, float], ...]
    """From when to when, s, the person was hard to see or to follow."""
    blur: float
    """Median variance of the Laplacian inside the mask; higher is sharper."""
    legs_seen: bool
    person_px: int
    """Height of the person in the clip that was judged."""
    advice: tuple[str, ...]
    """What to record again, and how."""

    def as_json(self) -> dict[str, Any]:
        """Plain values for sequence.json."""
        return asdict(self) | {
            "advice": list(self.advice),
            "coverage": dict(self.coverage),
            "frame_confidence": list(self.frame_confidence),
            "weak_s": [list(span) for span in self.weak_s],
        }

    def rows(self) -> list[tuple[str, str, str]]:
        """The report as a table: what was measured, its value, and the verdict."""
        total = self.frames_used + self.frames_lost
        sides = ", ".join(f"{side} {share:.0%}" for side, share in self.coverage.items())
        hidden = [side for side in SIDES if self.coverage[side] < _SIDE_SEEN]
        weakest = min(self.frame_confidence)
        return [
            ("Frames", f"{self.frames_used} of {total}", _verdict(self.frames_lost <= 0.1 * total)),
            ("Takes", str(self.takes), _verdict(self.takes <= self.recordings, "cuts")),
            ("Sides", sides, f"not seen: {', '.join(hidden)}" if hidden else "all round"),
            ("Legs", "seen" if self.legs_seen else "not seen", _verdict(self.legs_seen)),
            ("Person", f"{self.person_px} px tall", _verdict(self.person_px >= _SMALL_PX, "small")),
            (
                "Confidence",
                f"{self.confidence:.2f}, least {weakest:.2f}",
                f"weak {_spans(self.weak_s)}" if self.weak_s else "good",
            ),
            (
                "Landmarks",
                f"{self.landmark_error_px:.1f} px, {self.landmark_error_mm:.0f} mm off",
                _verdict(self.landmark_error <= _GOOD_ERROR),
            ),
            (
                "Joints on the mask",
                f"{self.joints_in_mask:.0%}",
                _verdict(self.joints_in_mask > 0.9),
            ),
            (
                "Body and mask agree",
                f"{self.mask_overlap:.0%}",
                _verdict(self.mask_overlap >= _GOOD_IOU),
            ),
            ("Sharpness", f"{self.blur:.0f}", _verdict(self.blur >= _SHARP, "blurred")),
        ]


def judge(clip: CapturedClip, recordings: int = 1) -> CaptureQuality:
    """Measure a capture of a clip that was made in so many recordings; say what to do better."""
    heights = [float(np.ptp(np.nonzero(mask > 0.5)[0]) + 1) for mask in clip.masks]
    person_px = int(np.median(heights))
    error_px = float(np.nanmean(_errors_px(clip)))
    frame_confidence = clip.motion.confidence.mean(axis=1)
    measured: dict[str, Any] = {
        "frames_used": len(clip.images),
        "frames_lost": clip.frames_lost,
        "takes": clip.takes,
        "recordings": recordings,
        "coverage": side_shares(clip.motion, clip.camera),
        "landmark_error_px": round(error_px, 3),
        "landmark_error": round(error_px / max(person_px, 1), 4),
        "landmark_error_mm": round(_error_mm(clip), 1),
        "joints_in_mask": round(_joints_in_mask(clip), 3),
        "mask_overlap": round(_mask_overlap(clip), 3),
        "confidence": round(float(frame_confidence.mean()), 3),
        "frame_confidence": tuple(np.round(frame_confidence, 3).tolist()),
        "weak_s": _weak_spans(clip),
        "blur": round(float(np.median([sharpness(*p) for p in _pairs(clip)])), 1),
        "legs_seen": clip.legs_seen,
        "person_px": person_px,
    }
    return CaptureQuality(**measured, advice=tuple(_advice(measured)))


def side_shares(motion: Motion, camera: Camera) -> dict[str, float]:
    """Share of frames in which each side of the person faces the camera."""
    facing = axis_angle_to_matrix(motion.joint_angles[:, 0])
    to_camera = camera.position - motion.root_translation
    local = np.einsum("fij,fi->fj", facing, to_camera)  # in the person's frame: x left, z front
    angle = np.arctan2(local[:, 0], local[:, 2])
    sector = np.round(angle / (0.5 * np.pi)).astype(int) % 4
    return {side: round(float((sector == i).mean()), 3) for i, side in enumerate(SIDES)}


def sharpness(image: UInt8[Array, "H W 3"], mask: Float[Array, "H W"]) -> float:
    """Variance of the Laplacian well inside the mask: its own edge must not count."""
    grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    laplacian = cv2.Laplacian(grey, cv2.CV_64F)
    inside = cv2.erode((mask > 0.9).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    return float(laplacian[inside].var()) if inside.any() else 0.0


def _depths_m(clip: CapturedClip) -> Float[Array, "F"]:
    """Of the pelvis, before the camera."""
    pelvis = clip.motion.root_translation + clip.body.skeleton.rest_joints[0]
    return clip.camera.project(pelvis)[1]


def _errors_px(clip: CapturedClip) -> Float[Array, "F 33"]:
    """Distances of landmarks from the body's, as they would be at the clip's usual distance."""
    depths_m = _depths_m(clip)
    return clip.landmark_error_px * (depths_m / np.median(depths_m))[:, None]


def _error_mm(clip: CapturedClip) -> float:
    """Mean distance of seen landmarks from the body's, at the depth of its pelvis."""
    focal_px = float(clip.camera.intrinsics[[0, 1], [0, 1]].mean())
    return 1e3 * float(np.nanmean(clip.landmark_error_px * _depths_m(clip)[:, None])) / focal_px


def _shown_confidence(clip: CapturedClip) -> Float[Array, "F"]:
    """Mean visibility of the joints that are in the picture: a face close by hides no legs."""
    motion, camera = clip.motion, clip.camera
    joints = clip.body.skeleton.joint_transforms(motion.joint_angles, motion.root_translation)
    pixels, _ = camera.project(joints[..., :3, 3])
    shown = ((pixels >= 0.0) & (pixels < [camera.width, camera.height])).all(axis=-1)
    seen = (motion.confidence * shown).sum(axis=1)
    return seen / np.maximum(shown.sum(axis=1), 1)


def _weak_spans(clip: CapturedClip) -> tuple[tuple[float, float], ...]:
    """Spans of frames, s, with low confidence or high error relative to the rest of the clip."""
    errors_px, confidence = _errors_px(clip), _shown_confidence(clip)
    known = ~np.isnan(errors_px)
    error = np.nansum(errors_px, axis=1) / np.maximum(known.sum(axis=1), 1)
    typical = np.median(error) + 1e-6
    weak = (confidence < _WEAK * np.median(confidence)) | (error > _WEAK_ERROR * typical)
    weak |= ~known.any(axis=1)
    times = clip.motion.times_s
    edges = np.flatnonzero(np.diff(np.concatenate([[False], weak, [False]]).astype(int)))
    spans = [(times[a], times[b - 1]) for a, b in edges.reshape(-1, 2)]
    return tuple((round(float(a), 2), round(float(b), 2)) for a, b in spans if b - a >= _WEAK_S)


def _spans(spans: tuple[tuple[float, float], ...]) -> str:
    return ", ".join(f"{start:.1f}-{end:.1f} s" for start, end in spans)


def _verdict(good: bool, otherwise: str = "poor") -> str:
    return "good" if good else otherwise


def _checked(clip: CapturedClip) -> list[int]:
    count = len(clip.images)
    return np.unique(np.linspace(0, count - 1, min(count, _CHECKED_FRAMES)).astype(int)).tolist()


def _pairs(clip: CapturedClip) -> list[tuple[Array, Array]]:
    return [(clip.images[i], clip.masks[i]) for i in _checked(clip)]


def _joints_in_mask(clip: CapturedClip) -> float:
    positions = clip.body.skeleton.joint_transforms(
        clip.motion.joint_angles, clip.motion.root_translation
    )[..., :3, 3]
    pixels, _ = clip.camera.project(positions)
    hits = []
    for frame, mask in enumerate(clip.masks):
        x, y = np.floor(pixels[frame]).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < mask.shape[1]) & (y < mask.shape[0])
        inside &= clip.motion.confidence[frame] > 0.5
        hits.append(mask[y[inside], x[inside]] > 0.5)
    on_mask = np.concatenate(hits)
    return float(on_mask.mean()) if len(on_mask) else 0.0


def _mask_overlap(clip: CapturedClip) -> float:
    shares = []
    for index in _checked(clip):
        pose, mask = clip.motion.pose(index), clip.masks[index] > 0.5
        covered = project_surface(clip.camera, clip.body, pose) > 0
        shares.append((covered & mask).sum() / max((covered | mask).sum(), 1))
    return float(np.mean(shares))


def _advice(found: Mapping[str, Any]) -> list[str]:
    lines = []
    total = found["frames_used"] + found["frames_lost"]
    hidden = [side for side in SIDES if found["coverage"][side] < _SIDE_SEEN]
    if hidden:
        lines.append(
            f"Hardly seen of the person: {', '.join(hidden)}. Colours there will be guessed: "
            "turn once, slowly, before the camera."
        )
    if not found["legs_seen"]:
        lines.append("Only the upper body is seen: step back until your feet are in the picture.")
    if found["frames_lost"] > 0.1 * total:
        lines.append(
            f"The person was lost in {found['frames_lost']} of {total} frames: stay inside the "
            "picture, alone and well lit."
        )
    if found["takes"] > found["recordings"]:
        lines.append(f"The picture jumps ({found['takes']} takes): film one take without cuts.")
    if found["blur"] < _SHARP:
        lines.append(
            f"The picture is blurred (sharpness {found['blur']:.0f}, better above {_SHARP:.0f}): "
            "move slowly, add light, clean the lens."
        )
    if found["person_px"] < _SMALL_PX:
        lines.append(f"The person is only {found['person_px']} px tall: come closer to the camera.")
    if found["weak_s"]:
        lines.append(
            f"The person was hard to follow at {_spans(found['weak_s'])} of the clip: film that "
            "part again, slowly, with nobody and nothing in front of you."
        )
    if found["landmark_error"] > _GOOD_ERROR or found["mask_overlap"] < _GOOD_IOU:
        lines.append(
            "The body was hard to follow: wear clothes close to the body, and keep arms and legs "
            "apart from the trunk while you turn."
        )
    return lines or ["Nothing needs to be filmed again."]
