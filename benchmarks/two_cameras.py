"""Real footage against a second camera that nobody has shown to the capture.

One person, filmed by two calibrated cameras at the same moments: the first is captured and trained
on, with its given focal length; the fit and the model are then looked at from the second. One
camera leaves one scale open (in effect the person's height), so figures are given with that scale
as it came and as fits best, one for the whole clip.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np

from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import clock_named
from capture.detection.landmarks import MediaPipeEstimator
from capture.detection.tracking import track_person
from capture.overlay import project_surface
from capture.pipeline import CaptureOptions, capture_clip
from capture.segmentation.masks import refine_mask
from capture.sources.video import read_video
from capture.storage import open_sequence
from renderer.performer_model import PerformerModel
from renderer.training import train
from scene.arrays import Array, Bool, Float, UInt8
from scene.camera import Camera
from scene.motion import Pose
from scene.sequence import Sequence

_UNITS_A_PIXEL = 64.0
_MM = 1e-3
_TRAINING_S = 60.0
_EVERY = 4
"""Frames judged: one in so many."""
_SCALES = np.linspace(0.8, 1.25, 19)
_REPORTED = ("landmark_error_px", "landmark_error_mm", "mask_overlap", "person_px")
_SHOWN = 60
"""The moment in the picture."""


@dataclass(frozen=True, eq=False)
class _Calibrated:
    """A camera of a Qualisys calibration file, OpenCV's axes, px and m."""

    intrinsics: Float[Array, "3 3"]
    rotation: Float[Array, "3 3"]
    translation: Float[Array, "3"]


def run(writer: FigureWriter, footage: Path, pose_model: Path, picture: Path | None) -> None:
    """Capture `footage`/cam01.mp4, train, and judge both from cam02's place."""
    first, second = (_calibrated(footage / "Calib.qca.txt", f"cam0{n}") for n in (1, 2))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "cam01.seq"
        options = CaptureOptions(
            person="cam01", pose_model=pose_model, focal_px=float(first.intrinsics[0, 0])
        )
        report = capture_clip(footage / "cam01.mp4", out, options)
        clip = open_sequence(out)
        clock = clock_named("processor")
        model = train(clip, preset="splats", budget_s=_TRAINING_S, clock=clock.now)
        other = _second_camera(clip, footage, first, second, pose_model)

        def fitted(view: Camera, pose: Pose) -> Array:
            return project_surface(view, clip.body, pose) > 0

        def refined(view: Camera, pose: Pose) -> Array:
            return fitted(view, model.motion.pose_at(pose.time_s))

        def drawn(view: Camera, pose: Pose) -> Array:
            return model.render(view, model.motion.pose_at(pose.time_s))[..., 3] > 0.5

        overlaps = {
            "body_as_fitted": other.overlap(fitted),
            "body_refined_while_training": other.overlap(refined),
            "model": other.overlap(drawn),
        }
        figures: dict[str, Any] = {
            "frames_judged": len(other.truth),
            "training_s": _TRAINING_S,
            **clock.about(),
            "mask_iou_in_the_second_camera": overlaps,
            "fit_in_the_first_camera": {key: report.as_json()[key] for key in _REPORTED},
        }
        writer.write(figures)
        if picture is not None:
            view, window = other.view(overlaps["model"]["scale"]), _around(other.truth[_SHOWN])
            _draw(picture, model, clip, other.images[_SHOWN], view, window)


@dataclass(frozen=True, eq=False)
class _SecondCamera:
    """What the second camera saw, and where it stood in the capture's world."""

    clip: Sequence
    images: tuple[UInt8[Array, "H W 3"], ...]
    truth: dict[int, Bool[Array, "H W"]]
    """The person's outline, filled, in the frames that are judged."""
    view: Callable[[float], Camera]
    """The camera, where the capture's metre is `1 / scale` of the true one."""

    def overlap(self, outline: Callable[[Camera, Pose], Array]) -> dict[str, float]:
        """Of `outline` with the truth: as it came, and with the one scale that fits best."""

        def mean(scale: float) -> float:
            view, train = self.view(scale), self.clip.train
            return float(
                np.mean(
                    [
                        _iou(outline(view, train.pose(index)), mask)
                        for index, mask in self.truth.items()
                    ]
                )
            )

        scaled = [mean(scale) for scale in _SCALES]
        best = float(_SCALES[int(np.argmax(scaled))])
        found = {"as_it_came": mean(1.0), "with_one_scale": max(scaled), "scale": best}
        return {key: round(value, 3) for key, value in found.items()}


def _second_camera(
    clip: Sequence, footage: Path, first: _Calibrated, second: _Calibrated, pose_model: Path
) -> _SecondCamera:
    seen = read_video(footage / "cam02.mp4")
    with MediaPipeEstimator(pose_model) as estimator:
        people = track_person(seen.images, estimator).people
    truth = {
        index: refine_mask(seen.images[index], person) > 0.5
        for index, person in enumerate(people)
        if person is not None and index % _EVERY == 0
    }
    height, width = seen.images[0].shape[:2]
    small = width / seen.source_size[0]
    return _SecondCamera(
        clip,
        seen.images,
        truth,
        lambda scale: _second_view(clip, first, second, scale, (width, height), small),
    )


def _calibrated(file: Path, serial: str) -> _Calibrated:
    camera = ElementTree.parse(file).find(f".//camera[@serial='{serial}']")
    assert camera is not None
    transform, inner = camera.find("transform"), camera.find("intrinsic")
    assert transform is not None
    assert inner is not None
    rows = [[float(transform.attrib[f"r{r}{c}"]) for c in "123"] for r in "123"]
    rotation = np.diag([1.0, -1.0, -1.0]) @ np.array(rows)  # Qualisys looks along -z
    place = _MM * np.array([float(transform.attrib[axis]) for axis in "xyz"])
    focal, centre = (
        [float(inner.attrib[f"{name}{axis}"]) / _UNITS_A_PIXEL for axis in "UV"]
        for name in ("focalLength", "centerPoint")
    )
    # the videos show 1080 of the sensor's 1088 columns, from the middle
    intrinsics = np.array(
        [[focal[0], 0.0, centre[0] - 4.0], [0.0, focal[1], centre[1]], [0.0, 0.0, 1.0]]
    )
    return _Calibrated(intrinsics, rotation, -rotation @ place)


def _second_view(
    clip: Sequence,
    first: _Calibrated,
    second: _Calibrated,
    scale: float,
    size: tuple[int, int],
    small: float,
) -> Camera:
    """The second camera in the capture's world, whose metre is `1 / scale` of the true one."""
    own = clip.train.camera(0).world_to_camera
    # capture takes the picture's middle for the principal point: nearly a small turn
    middle = np.array([540.0, 960.0])
    tilt = (middle - first.intrinsics[:2, 2]) / first.intrinsics[0, 0]
    turn = cv2.Rodrigues(np.array([-tilt[1], tilt[0], 0.0]))[0]
    between = second.rotation @ first.rotation.T
    shift = second.translation - between @ first.translation
    rotation = between @ turn @ own[:, :3]
    translation = between @ turn @ own[:, 3] + shift / scale
    intrinsics = second.intrinsics.copy()
    intrinsics[:2] *= small
    return Camera(intrinsics, np.concatenate([rotation, translation[:, None]], axis=1), *size)


def _iou(a: Array, b: Array) -> float:
    return float((a & b).sum() / max((a | b).sum(), 1))


def _around(mask: Array) -> tuple[int, int, int, int]:
    """x, y, width, height of a window half as wide as high that holds the person."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    high = round(1.15 * (rows[-1] - rows[0]))
    wide = max(round(1.15 * (columns[-1] - columns[0])), high // 2)
    x, y = (columns[0] + columns[-1] - wide) // 2, (rows[0] + rows[-1] - high) // 2
    x, y = max(0, int(x)), max(0, int(y))
    return x, y, min(wide, mask.shape[1] - x), min(high, mask.shape[0] - y)


def _draw(
    path: Path,
    model: PerformerModel,
    clip: Sequence,
    other: Array,
    view: Camera,
    window: tuple[int, int, int, int],
) -> None:
    """Training frame, the model from there, the second camera's frame, the model from there."""
    x, y, w, h = window
    left, top, wide, high = _around(clip.train.mask(_SHOWN) > 0.5)
    part = slice(top, top + high), slice(left, left + wide)
    own, pose = clip.train.camera(_SHOWN), model.motion.pose_at(clip.train.pose(_SHOWN).time_s)
    panels = [
        (clip.train.image(_SHOWN) + (1.0 - clip.train.mask(_SHOWN)[..., None]))[part],
        _over_white(model.render(own, pose))[part],
        other[y : y + h, x : x + w] / 255.0,
        _over_white(model.render(view.cropped(x, y, w, h), pose)),
    ]
    tall = 640
    shown = [
        cv2.resize(
            p.astype(np.float32),
            (round(tall * p.shape[1] / p.shape[0]), tall),
            interpolation=cv2.INTER_AREA,
        )
        for p in panels
    ]
    whole = (255.0 * np.clip(np.concatenate(shown, axis=1), 0.0, 1.0) + 0.5).astype(np.uint8)
    cv2.imwrite(str(path), whole[..., ::-1])


def _over_white(rgba: Array) -> Array:
    return rgba[..., :3] + (1.0 - rgba[..., 3:])
