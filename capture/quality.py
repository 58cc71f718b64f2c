"""What a capture is worth, before anyone waits for training, and what to film again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from capture.overlay import project_surface
from scene.arrays import Array, Float, UInt8
from scene.body import Body
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


@dataclass(frozen=True)
class CaptureQuality:
    """The report; every share is 0 to 1."""

    frames_used: int
    frames_lost: int
    """Sampled frames in which the person was not found."""
    takes: int
    """Runs of frames without a jump of the picture."""
    coverage: Mapping[str, float]
    """Share of frames that show each side."""
    landmark_error_px: float
    """Mean distance of seen landmarks from the fitted body's, px of the stored frames."""
    landmark_error: float
    """The same in heights of the person's box."""
    joints_in_mask: float
    """Share of seen joints that fall on the mask."""
    mask_overlap: float
    """Intersection over union of the mask and the projected surface."""
    confidence: float
    """Mean visibility of the joints."""
    blur: float
    """Median variance of the Laplacian inside the mask; higher is sharper."""
    legs_seen: bool
    person_px: int
    """Height of the person in the stored frames."""
    advice: tuple[str, ...]
    """In plain words: what to film again, and how."""

    def as_json(self) -> dict[str, Any]:
        """Plain values for sequence.json."""
        return asdict(self) | {"advice": list(self.advice), "coverage": dict(self.coverage)}


@dataclass(frozen=True, eq=False)
class Seen:
    """What the report is made of; pictures are those that are stored."""

    images: Sequence[UInt8[Array, "H W 3"]]
    masks: Sequence[Float[Array, "H W"]]
    camera: Camera
    body: Body
    motion: Motion
    landmark_error_px: Float[Array, "F 33"]
    """NaN where a landmark was not seen."""
    frames_lost: int
    takes: int
    legs_seen: bool


def judge(seen: Seen) -> CaptureQuality:
    """Measure a capture and say what to do better."""
    heights = [float(np.ptp(np.nonzero(mask > 0.5)[0]) + 1) for mask in seen.masks]
    person_px = int(np.median(heights))
    error_px = float(np.nanmean(seen.landmark_error_px))
    measured: dict[str, Any] = {
        "frames_used": len(seen.images),
        "frames_lost": seen.frames_lost,
        "takes": seen.takes,
        "coverage": side_shares(seen.motion, seen.camera),
        "landmark_error_px": round(error_px, 3),
        "landmark_error": round(error_px / max(person_px, 1), 4),
        "joints_in_mask": round(_joints_in_mask(seen), 3),
        "mask_overlap": round(_mask_overlap(seen), 3),
        "confidence": round(float(seen.motion.confidence.mean()), 3),
        "blur": round(float(np.median([sharpness(*p) for p in _pairs(seen)])), 1),
        "legs_seen": seen.legs_seen,
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


def _checked(seen: Seen) -> list[int]:
    count = len(seen.images)
    return np.unique(np.linspace(0, count - 1, min(count, _CHECKED_FRAMES)).astype(int)).tolist()


def _pairs(seen: Seen) -> list[tuple[Array, Array]]:
    return [(seen.images[i], seen.masks[i]) for i in _checked(seen)]


def _joints_in_mask(seen: Seen) -> float:
    placed = seen.body.skeleton.joint_transforms(
        seen.motion.joint_angles, seen.motion.root_translation
    )[..., :3, 3]
    pixels, _ = seen.camera.project(placed)
    hits = []
    for frame, mask in enumerate(seen.masks):
        x, y = np.floor(pixels[frame]).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < mask.shape[1]) & (y < mask.shape[0])
        inside &= seen.motion.confidence[frame] > 0.5
        hits.append(mask[y[inside], x[inside]] > 0.5)
    found = np.concatenate(hits)
    return float(found.mean()) if len(found) else 0.0


def _mask_overlap(seen: Seen) -> float:
    shares = []
    for index in _checked(seen):
        pose, mask = seen.motion.pose(index), seen.masks[index] > 0.5
        covered = project_surface(seen.camera, seen.body, pose) > 0
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
    if found["takes"] > 1:
        lines.append(f"The picture jumps ({found['takes']} takes): film one take without cuts.")
    if found["blur"] < _SHARP:
        lines.append(
            f"The picture is blurred (sharpness {found['blur']:.0f}, better above {_SHARP:.0f}): "
            "move slowly, add light, clean the lens."
        )
    if found["person_px"] < _SMALL_PX:
        lines.append(f"The person is only {found['person_px']} px tall: come closer to the camera.")
    if found["landmark_error"] > _GOOD_ERROR or found["mask_overlap"] < _GOOD_IOU:
        lines.append(
            "The body was hard to follow: wear clothes close to the body, and keep arms and legs "
            "apart from the trunk while you turn."
        )
    return lines or ["Nothing needs to be filmed again."]
