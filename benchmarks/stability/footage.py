"""Footage, landmarks and masks of one performance, disturbed before a capture gets them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from benchmarks.stability.pictures import CROPS, rows_until
from capture.body.landmarks import MIRROR
from capture.detection.landmarks import Landmarks, PoseEstimator
from capture.studio.performer import make_performer, render_performer
from scene.arrays import Array, UInt8
from scene.sequence import Sequence as Clip
from scene.sequence import read_frame

RATE = 15.0
"""Frames a second of what is captured."""
RENDERED_RATE = 30.0
NOISE = 3.0
"""Of the sensor, levels of 255."""
_STEP = round(RENDERED_RATE / RATE)
_HOLE_SHARE = 0.08
"""Radius of a hole in a mask, as a share of the person's height."""
_WALKS_FROM_M, _WALKS_BEHIND_M = 1.6, 1.5

Pictures = Sequence[UInt8[Array, "H W 3"]]
Degrade = Callable[[Landmarks, np.random.Generator], Landmarks]


@dataclass(frozen=True)
class Variant:
    """What is wrong with a capture; as it is here, nothing."""

    rate: float = RATE
    pictures: Callable[[Clip, Pictures], Pictures] = lambda _, images: images
    degrade: Degrade | None = None
    focal_known: bool = True


class Degraded:
    """An estimator whose detections are degraded, repeatably."""

    def __init__(self, inner: PoseEstimator, degrade: Degrade) -> None:
        self._inner, self._degrade, self._rng = inner, degrade, np.random.default_rng(0)

    def detect(self, image: UInt8[Array, "H W 3"]) -> list[Landmarks]:
        return [self._degrade(person, self._rng) for person in self._inner.detect(image)]


def dropped(share: float) -> Degrade:
    """Landmarks that come and go."""

    def degrade(person: Landmarks, rng: np.random.Generator) -> Landmarks:
        kept = rng.uniform(size=len(person.visibility)) >= share
        return replace(person, visibility=person.visibility * kept)

    return degrade


def exchanged(share: float) -> Degrade:
    """Left and right taken for one another in a share of the frames."""

    def degrade(person: Landmarks, rng: np.random.Generator) -> Landmarks:
        order = list(MIRROR)
        if rng.uniform() >= share:
            return person
        return replace(
            person,
            pixels=person.pixels[order],
            world=person.world[order],
            visibility=person.visibility[order],
        )

    return degrade


def holed(count: float) -> Degrade:
    """So many holes in each mask."""

    def degrade(person: Landmarks, rng: np.random.Generator) -> Landmarks:
        mask = person.mask.copy()
        rows, columns = np.nonzero(mask > 0.5)
        for _ in range(int(count) if len(rows) else 0):
            at = rng.integers(len(rows))
            radius = round(_HOLE_SHARE * float(person.box[3] - person.box[1]))
            cv2.circle(mask, (int(columns[at]), int(rows[at])), radius, 0.0, -1)
        return replace(person, mask=mask)

    return degrade


def outlined(px: float) -> Degrade:
    """The edge of each mask further out by `px`, or in where that is below nil."""
    size = 2 * round(abs(px)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    moved = cv2.dilate if px > 0.0 else cv2.erode

    def degrade(person: Landmarks, rng: np.random.Generator) -> Landmarks:
        del rng
        return replace(person, mask=moved(person.mask, disc).astype(np.float32))

    return degrade


def shrunk(share: float) -> Callable[[Clip, Pictures], Pictures]:
    """Footage of a share of the size."""
    return lambda _, images: [
        cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA).astype(np.uint8)
        for image in images
    ]


def darkened(stops: float) -> Callable[[Clip, Pictures], Pictures]:
    """Less light, and no gain that makes up for it; noise stays."""

    def dark(_: Clip, images: Pictures) -> Pictures:
        rng, light = np.random.default_rng(0), 2.0 ** (-stops / 2.2)
        return [
            np.clip(light * image + rng.normal(0.0, NOISE, image.shape), 0, 255).astype(np.uint8)
            for image in images
        ]

    return dark if stops else lambda _, images: images


def rolled(degrees: float) -> Callable[[Clip, Pictures], Pictures]:
    """A camera in somebody's hand, which rolls to and fro."""

    def turned(image: Array, angle: float) -> UInt8[Array, "H W 3"]:
        high, wide = image.shape[:2]
        turn = cv2.getRotationMatrix2D((0.5 * wide, 0.5 * high), angle, 1.0)
        return cv2.warpAffine(image, turn, (wide, high), borderMode=cv2.BORDER_REPLICATE).astype(
            np.uint8
        )

    def roll(_: Clip, images: Pictures) -> Pictures:
        swing = degrees * np.sin(6.0 * np.pi * np.arange(len(images)) / len(images))
        return [turned(image, float(a)) for image, a in zip(images, swing, strict=True)]

    return roll if degrees else lambda _, images: images


def cut(step: float) -> Callable[[Clip, Pictures], Pictures]:
    """Nothing but black below the knees, the waist or the bust: the middle of the picture stays
    that of the lens."""

    def ended(truth: Clip, images: Pictures) -> Pictures:
        rows = rows_until(read_frame(truth.train, 0), truth.body.skeleton, CROPS[int(step)])
        return [_black_below(image, rows) for image in images]

    return ended


def _black_below(image: UInt8[Array, "H W 3"], rows: int) -> UInt8[Array, "H W 3"]:
    ended = image.copy()
    ended[rows:] = 0
    return ended


def passed_by(truth: Clip, images: Pictures) -> Pictures:
    """Another performer walks through behind the first."""
    other, made = make_performer(40), []
    for index, image in enumerate(images):
        frame = index * _STEP
        camera, count = truth.train.camera(frame), len(truth.train)
        pose = truth.train.pose((frame + count // 3) % count)
        sideways = _WALKS_FROM_M * (2.0 * index / len(images) - 1.0)
        across = np.array([sideways, 0.0, -_WALKS_BEHIND_M])
        seen, alpha = render_performer(other, replace(pose, root_translation=across), camera, "lit")
        free = 1.0 - truth.train.mask(frame)[..., None]
        mixed = image / 255.0 * (1.0 - alpha[..., None] * free) + seen * free
        made.append(np.clip(255.0 * mixed + 0.5, 0, 255).astype(np.uint8))
    return made
