"""Masks and colours of captured frames against the studio's exact ones, stage by stage.

Raw footage (a room, noise, a lens) is followed and cut out as a capture does it. Judged in a band
of four pixels to both sides of the true edge: errors of alpha, of the premultiplied colour that is
stored, and flicker, the change of alpha from frame to frame that the truth does not have.

Painted performers stand in a painted room and are judged by the sharp alpha; lifelike ones stand
before pictures of real places and are judged by what the lens made of alpha, which a matte can
reach. Masks of real people are judged by the ruler's, which an earlier segmentation drew.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.real.cases import CASES
from benchmarks.real.ruler import Ruler
from benchmarks.reporting.figures import FigureWriter
from capture.detection.landmarks import Landmarks, MediaPipeEstimator
from capture.detection.network_files import landmark_network_file
from capture.detection.tracking import track_person
from capture.segmentation.background import learn_background
from capture.segmentation.clip import segment_clip
from capture.segmentation.foreground import premultiplied
from capture.segmentation.masks import dilated_person_mask, refine_mask, smooth_masks
from capture.sources.video import read_video
from capture.storage import open_sequence
from capture.studio import Footage, make_sequence
from scene.arrays import Array
from services.settings import load_settings

PERFORMERS = {"lit": (1, 360.0), "loose": (3, 180.0)}
"""Look -> seed, and how far they turn, degrees."""
LIFELIKE = {
    "hazel": ("real-four-cameras/charuco_calibration/cam_2.mp4", 160),
    "jasper": ("real-full-body/05_default_juggle.mp4", 180),
}
"""Performer -> clip whose first frame shows the place behind them, at its left end, and its top
row there."""
FRAMES, RATE, SIZE, BAND_PX = 36, 15.0, 512, 4
NOISE, LENS_PX = 3.0, 0.6
_ALL_FRAMES = 100_000


def run(writer: FigureWriter, motion: Path, assets: Path, footage: Path) -> None:
    """Measure and report."""
    figures = {}
    for look in PERFORMERS:
        with tempfile.TemporaryDirectory(prefix="metanerf-bench-") as folder:
            figures[look] = _measure(*_render(Path(folder), look))
    for name in LIFELIKE if assets.is_dir() else ():
        figures[name] = _measure(*_lifelike(name, motion, assets, footage))
    about = {"size": f"{SIZE}x{SIZE}", "frames": FRAMES, "band_px": BAND_PX}
    real = {case.trained: _real(case.trained, footage) for case in CASES}
    writer.write({**about, **figures, "real": real})


def _render(folder: Path, look: str) -> tuple[list[Array], list[Landmarks], Array, Array]:
    """Frames and people that were detected, with their true masks and premultiplied colours."""
    seed, turn_deg = PERFORMERS[look]
    raw = folder / "raw.mp4"
    make_sequence(
        folder / "truth",
        look=look,
        seed=seed,
        turn_deg=turn_deg,
        frames=FRAMES,
        size=SIZE,
        test_cameras=1,
        frames_per_second=RATE,
        footage=Footage(raw, background="textured", noise=NOISE, blur_px=LENS_PX),
    )
    truth, images = open_sequence(folder / "truth").train, read_video(raw).images
    colour, alpha = (
        np.stack([each(i) for i in range(len(images))]) for each in (truth.image, truth.mask)
    )
    return _detected(images, alpha, colour)


def _lifelike(
    name: str, motion: Path, assets: Path, footage: Path
) -> tuple[list[Array], list[Landmarks], Array, Array]:
    """The same of a lifelike performer before a real place; truth as the lens shows it."""
    clip, top = LIFELIKE[name]
    place = read_video(footage / clip, max_frames=2, max_side=4096).images[0]
    place = place[top : top + SIZE, :SIZE] / np.float32(255.0)
    with tempfile.TemporaryDirectory(prefix="metanerf-bench-") as folder:
        make_sequence(
            Path(folder) / "truth",
            performer=name,
            assets=assets,
            motion=motion,
            look="lit",
            turn_deg=180.0,
            frames=FRAMES,
            size=SIZE,
            test_cameras=1,
            frames_per_second=RATE,
        )
        truth = open_sequence(Path(folder) / "truth").train
        colour, alpha = (
            np.stack([cv2.GaussianBlur(each(i), (0, 0), LENS_PX) for i in range(FRAMES)])
            for each in (truth.image, truth.mask)
        )
    rng = np.random.default_rng(0)
    seen = 255.0 * (colour + (1.0 - alpha[..., None]) * cv2.GaussianBlur(place, (0, 0), LENS_PX))
    seen += rng.normal(0.0, NOISE, seen.shape)
    return _detected(list(np.clip(seen + 0.5, 0.0, 255.0).astype(np.uint8)), alpha, colour)


def _detected(
    images: Sequence[Array], alpha: Array, colour: Array
) -> tuple[list[Array], list[Landmarks], Array, Array]:
    people = _tracked(images)
    found = [i for i, person in enumerate(people) if person is not None]
    detected = [person for person in people if person is not None]
    return [images[i] for i in found], detected, alpha[found], colour[found]


def _tracked(images: Sequence[Array]) -> Sequence[Landmarks | None]:
    with MediaPipeEstimator(
        landmark_network_file(load_settings().pose_model_source())
    ) as estimator:
        return track_person(images, estimator).people


def _real(name: str, footage: Path) -> dict[str, Any]:
    """Overlap and error of alpha of a clip's masks, by its ruler."""
    ruler = Ruler.read(name)
    images = read_video(ruler.require_footage(footage), max_frames=_ALL_FRAMES).images
    people = _tracked(images)
    masks, work_ms = _timed(lambda: segment_clip(images, people), len(images))
    found = [i for i in ruler.indices if masks[i] is not None]
    size = images[0].shape[1::-1]
    alpha, hidden = (
        np.stack([cv2.resize(each(i), size, interpolation=cv2.INTER_AREA) for i in found])
        for each in (ruler.mask, ruler.hidden)
    )
    judged = hidden == 0.0
    ours = np.stack([np.asarray(masks[i]) for i in found])
    return {
        "overlap": round(_overlap(ours * judged, alpha * judged), 4),
        "alpha_error": round(float(np.abs(ours - alpha)[_band(alpha) & judged].mean()), 4),
        "work_ms": work_ms,
    }


def _measure(
    images: list[Array], people: list[Landmarks], alpha: Array, colour: Array
) -> dict[str, Any]:
    def judged(masks: list[Array], pictures: list[Array] | None, work_ms: float) -> dict[str, Any]:
        if pictures is None:
            pictures = [
                image / np.float32(255.0) * mask[..., None]
                for image, mask in zip(images, masks, strict=True)
            ]
        return _errors(np.stack(masks), np.stack(pictures), alpha, colour) | {"work_ms": work_ms}

    figures = {"estimator": judged([person.mask for person in people], None, 0.0)}
    cut, cut_ms = _timed(lambda: list(map(refine_mask, images, people)))
    figures["cut"] = judged(cut, None, cut_ms)
    backdrop, learn_ms = _timed(lambda: learn_background(images, map(dilated_person_mask, people)))
    cut, cut_ms = _timed(
        lambda: [refine_mask(i, p, backdrop) for i, p in zip(images, people, strict=True)]
    )
    figures["with_backdrop"] = judged(cut, None, round(learn_ms + cut_ms, 1))
    steady, steady_ms = _timed(lambda: [m for m in smooth_masks(images, cut) if m is not None])
    figures["steady"] = judged(steady, None, steady_ms)
    own, own_ms = _timed(lambda: list(map(premultiplied, images, steady)))
    figures["own_colours"] = judged(steady, own, own_ms)
    exact = list(alpha)
    figures["true_alpha"] = judged(exact, None, 0.0)
    own = list(map(premultiplied, images, exact))
    figures["true_alpha_own_colours"] = judged(exact, own, 0.0)
    return figures


def _timed(work: Callable[[], Any], frames: int = FRAMES) -> tuple[Any, float]:
    """The result of `work`, and ms of the processor a frame."""
    started = time.process_time()
    done = work()
    return done, round((time.process_time() - started) * 1e3 / frames, 1)


def _errors(masks: Array, pictures: Array, alpha: Array, colour: Array) -> dict[str, float]:
    band = _band(alpha)
    flicker = np.abs(np.diff(masks, axis=0) - np.diff(alpha, axis=0))[band[1:] | band[:-1]]
    return {
        "overlap": round(_overlap(masks, alpha), 4),
        "alpha_error": round(float(np.abs(masks - alpha)[band].mean()), 4),
        "colour_error_levels": round(255.0 * float(np.abs(pictures - colour)[band].mean()), 2),
        "flicker": round(float(flicker.mean()), 4),
    }


def _band(alpha: Array) -> Array:
    """Where the edge of each mask is at most `BAND_PX` away."""
    kernel = np.ones((2 * BAND_PX + 1,) * 2, np.uint8)
    solid = [(mask > 0.5).astype(np.uint8) for mask in alpha]
    return np.stack([cv2.dilate(m, kernel) > cv2.erode(m, kernel) for m in solid])


def _overlap(masks: Array, alpha: Array) -> float:
    predicted, truth = masks > 0.5, alpha > 0.5
    shares = (predicted & truth).sum(axis=(1, 2)) / (predicted | truth).sum(axis=(1, 2))
    return float(shares.mean())
