"""One picture of a model beside the frame it should show: figures on body, face and hands."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
import torch

from benchmarks.real.parts import (
    PartFinder,
    Window,
    eye_distance,
    irises_in_eyes,
    window_around,
)
from renderer.evaluation.lpips import Lpips
from renderer.evaluation.metrics import psnr, ssim
from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera
from scene.motion import Pose
from scene.sequence import body_crop

_FACE_GROW, _FACE_LEAST_PX = 1.4, 32
_HAND_GROW, _HAND_LEAST_PX = 1.5, 24
_SEARCH_GROW = 2.2
"""A face is looked for in so many times its true size."""
_LPIPS_LEAST_PX = 96
"""Smaller crops are enlarged, both alike, until LPIPS' features see more than a few pixels."""
_GREY = 0.5
"""Behind a figure in which a face is looked for."""

Figures = dict[str, float | None]


@dataclass(frozen=True, eq=False)
class TestFrame:
    """A frame that is judged."""

    __test__ = False  # no test, whatever pytest thinks of the name

    group: str
    clip: str
    index: int
    image: UInt8[Array, "H W 3"]
    mask: Float[Array, "H W"]
    hidden: Float[Array, "H W"]
    """1 where something in front hides the person: not judged."""
    face: Float[Array, "478 2"] | None
    hands: tuple[Float[Array, "21 2"], ...]
    camera: Camera
    pose: Pose
    """As given: by the capture of this clip, or by training for frames that it saw."""

    @property
    def truth(self) -> Float[Array, "H W 3"]:
        """sRGB over black."""
        return self.image.astype(np.float32) / np.float32(255.0) * self.mask[..., None]

    def crops(self) -> dict[str, list[tuple[slice, slice]]]:
        """Rows and columns of the body, the face and each hand, as far as they are seen."""
        body, shape = body_crop(self.mask), self.mask.shape
        faces = [] if self.face is None else [window_around(self.face, _FACE_GROW, _FACE_LEAST_PX)]
        hands = [window_around(hand, _HAND_GROW, _HAND_LEAST_PX) for hand in self.hands]
        return {
            "body": [] if body is None else [body],
            "face": _inside(faces, shape),
            "hands": _inside(hands, shape),
        }


@dataclass(frozen=True, eq=False)
class Judge:
    """What every picture is measured with."""

    lpips: Lpips
    finder: PartFinder

    def figures(self, rendered: Float[Array, "H W 4"], frame: TestFrame) -> dict[str, Figures]:
        """`body`, `face`, `hands`: PSNR (dB), SSIM, LPIPS; of the body also the silhouette's
        intersection over union; of the face also whether a landmarker finds it (0 or 1), how far
        its points lie from the frame's, in per cent of the distance between the eyes, and how far
        its irises lie from where they are between the corners of the frame's eyes, in per cent of
        an eye's width."""
        rendered = rendered * (1.0 - frame.hidden[..., None])
        colour, truth = np.clip(rendered[..., :3], 0.0, 1.0), frame.truth
        found: dict[str, Figures] = {}
        for part, windows in frame.crops().items():
            pairs = [(colour[window], truth[window]) for window in windows]
            found[part] = {
                "psnr": mean(min(psnr(a, b), 100.0) for a, b in pairs),
                "ssim": mean(ssim(a, b) for a, b in pairs),
                "lpips": mean(crop_lpips(self.lpips, a, b) for a, b in pairs),
            }
        inside, person = rendered[..., 3] > 0.5, frame.mask > 0.5
        found["body"]["iou"] = float((inside & person).sum() / max((inside | person).sum(), 1))
        if frame.face is not None:
            found["face"] |= self._face(rendered, frame.face)
        return found

    def _face(self, rendered: Float[Array, "H W 4"], truth: Float[Array, "478 2"]) -> Figures:
        over_grey = rendered[..., :3] + _GREY * (1.0 - rendered[..., 3:])
        picture = (255.0 * np.clip(over_grey, 0.0, 1.0) + 0.5).astype(np.uint8)
        points = self.finder.face(picture, window_around(truth, _SEARCH_GROW, _FACE_LEAST_PX))
        if points is None:
            return {"found": 0.0, "points_percent": None, "irises_percent": None}
        apart = np.linalg.norm(points - truth, axis=1).mean()
        looking = np.linalg.norm(irises_in_eyes(points) - irises_in_eyes(truth), axis=1).mean()
        return {
            "found": 1.0,
            "points_percent": 100.0 * float(apart) / eye_distance(truth),
            "irises_percent": 100.0 * float(looking),
        }


@torch.no_grad()
def crop_lpips(
    lpips: Lpips, rendered: Float[Array, "H W 3"], truth: Float[Array, "H W 3"]
) -> float:
    """LPIPS of a crop, however small it is."""
    scale = max(1.0, _LPIPS_LEAST_PX / min(rendered.shape[:2]))
    pair = [
        torch.from_numpy(
            np.ascontiguousarray(cv2.resize(picture, None, fx=scale, fy=scale), np.float32)
        ).movedim(-1, 0)[None]
        for picture in (rendered, truth)
    ]
    return float(lpips(*pair)[0])


def flicker(model: PerformerModel, before: TestFrame, after: TestFrame) -> float:
    """How much the model's picture changes from one frame to the next, mean over the person in
    either, as a multiple of how much the film does."""
    early, late = (model.render(f.camera, f.pose)[..., :3].copy() for f in (before, after))
    return changes((early, late), (before, after))


def changes(
    rendered: tuple[Float[Array, "H W 3"], Float[Array, "H W 3"]],
    frames: tuple[TestFrame, TestFrame],
) -> float:
    """`flicker` of two pictures that are rendered already."""
    person = (frames[0].mask > 0.5) | (frames[1].mask > 0.5)
    truth = (frames[0].truth, frames[1].truth)
    changed, filmed = (
        float(np.abs(late - early)[person].mean()) for early, late in (rendered, truth)
    )
    return changed / max(filmed, 1e-6)


def mean(values: Iterable[float | None]) -> float | None:
    """Of those that there are; None without any."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _inside(windows: list[Window], shape: tuple[int, ...]) -> list[tuple[slice, slice]]:
    """Cut to the picture; those of which too little is left are not judged."""
    cut = [
        (slice(max(y, 0), min(y + h, shape[0])), slice(max(x, 0), min(x + w, shape[1])))
        for x, y, w, h in windows
    ]
    return [
        window
        for window in cut
        if all(side.stop - side.start >= _HAND_LEAST_PX // 2 for side in window)
    ]
