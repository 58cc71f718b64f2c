"""Masks and colours of captured frames against the studio's exact ones, stage by stage.

Raw footage (a room, noise, a lens) is followed and cut out as a capture does it. Judged in a band
of four pixels to both sides of the true edge: errors of alpha, of the premultiplied colour that is
stored, and flicker, the change of alpha from frame to frame that the truth does not have.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.reporting.figures import FigureWriter
from capture.detection.landmarks import Landmarks, MediaPipeEstimator
from capture.detection.network_files import landmark_network_file
from capture.detection.tracking import track_person
from capture.segmentation.background import learn_background
from capture.segmentation.foreground import premultiplied
from capture.segmentation.masks import dilated_person_mask, refine_mask, smooth_masks
from capture.sources.video import read_video
from capture.storage import open_sequence
from capture.studio import Footage, make_sequence
from scene.arrays import Array
from services.settings import load_settings

PERFORMERS = {"lit": (1, 360.0), "loose": (3, 180.0)}
"""Look -> seed, and how far they turn, degrees."""
FRAMES, RATE, SIZE, BAND_PX = 36, 15.0, 512, 4


def run(writer: FigureWriter) -> None:
    """Measure and report."""
    figures = {}
    for look in PERFORMERS:
        with tempfile.TemporaryDirectory(prefix="metanerf-bench-") as folder:
            figures[look] = _measure(*_render(Path(folder), look))
    about = {"size": f"{SIZE}x{SIZE}", "frames": FRAMES, "band_px": BAND_PX}
    writer.write({**about, **figures})


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
        footage=Footage(raw, background="textured", noise=3.0, blur_px=0.6),
    )
    truth, images = open_sequence(folder / "truth").train, read_video(raw).images
    with MediaPipeEstimator(
        landmark_network_file(load_settings().pose_model_source())
    ) as estimator:
        people = track_person(images, estimator).people
    detected = [(i, person) for i, person in enumerate(people) if person is not None]
    return (
        [images[i] for i, _ in detected],
        [person for _, person in detected],
        np.stack([truth.mask(i) for i, _ in detected]),
        np.stack([truth.image(i) for i, _ in detected]),
    )


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


def _timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """The result of `work`, and ms of the processor a frame."""
    started = time.process_time()
    done = work()
    return done, round((time.process_time() - started) * 1e3 / FRAMES, 1)


def _errors(masks: Array, pictures: Array, alpha: Array, colour: Array) -> dict[str, float]:
    kernel = np.ones((2 * BAND_PX + 1,) * 2, np.uint8)
    solid = [(mask > 0.5).astype(np.uint8) for mask in alpha]
    band = np.stack([cv2.dilate(m, kernel) > cv2.erode(m, kernel) for m in solid])
    predicted, truth = masks > 0.5, alpha > 0.5
    overlap = (predicted & truth).sum(axis=(1, 2)) / (predicted | truth).sum(axis=(1, 2))
    flicker = np.abs(np.diff(masks, axis=0) - np.diff(alpha, axis=0))[band[1:] | band[:-1]]
    return {
        "overlap": round(float(overlap.mean()), 4),
        "alpha_error": round(float(np.abs(masks - alpha)[band].mean()), 4),
        "colour_error_levels": round(255.0 * float(np.abs(pictures - colour)[band].mean()), 2),
        "flicker": round(float(flicker.mean()), 4),
    }
