"""Masks and pictures that are worse than those of the studio: what a webcam, a room and a matte do.

A frame is put before a room, spoilt as a camera would, and cut out again by its mask, as a capture
cuts it out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from benchmarks.stability.material import Material, Subject
from benchmarks.stability.video import through_h264
from capture.studio.room import room_background
from renderer.evaluation.evaluate import side_of_body
from renderer.person_frames import LEAST_FRAMES
from scene.arrays import Array, Float
from scene.sequence import Frame, body_crop
from scene.skeleton import JOINT_NAMES, Skeleton

REFERENCE_PX = 256
"""Widths in px are those of a picture of so many rows."""
_ROOM_SEED = 5
_GAMMA = 2.2
_FULL_WELL, _READ_NOISE = 2000.0, 4.0
"""Electrons of a webcam's pixel when it is white, and its noise when it is black."""
_HOLE_SHARE = 0.04
"""Radius of a hole in a mask, as a share of the person's height."""
_LEAST_ROWS = 24
_UPHOLSTERY, _RIBS, _ROUNDED = (0.46, 0.27, 0.16), 3.0, 0.5
"""A chair's brown; how fast its ribs follow one another, and how round its corners are."""
UNCOMPRESSED_BITS = 24.0
"""A pixel of footage that nothing was done to."""
CROPS = ("full body", "knees", "waist", "bust")
_CUT_AT = {"knees": ("left_knee", "right_knee"), "waist": ("pelvis",), "bust": ("spine3",)}

Camera01 = Callable[[Float[Array, "H W 3"], int, int], Float[Array, "H W 3"]]
"""A picture in [0, 1], its number and the number of pictures, as a camera would show it."""
Footage = Callable[[list[Float[Array, "H W 3"]]], Iterable[Float[Array, "H W 3"]]]
"""All pictures of a clip, in [0, 1], as they come back from where they were filmed."""


def dilated_mask(subject: Subject, px: float, rng: np.random.Generator) -> Material:
    """Masks too wide by `px`, with what lies behind the person."""
    del rng
    return _each(subject, partial(_dilated, room=_room(subject), px=px))


def eroded_mask(subject: Subject, px: float, rng: np.random.Generator) -> Material:
    """Masks too narrow by `px`."""
    del rng
    return _each(subject, lambda frame: _cut(frame, cv2.erode(frame.mask, _disc(frame, px))))


def holed_mask(subject: Subject, share: float, rng: np.random.Generator) -> Material:
    """Round holes in each mask, elsewhere in every frame, until `share` of it is gone."""
    return _each(subject, lambda frame: _cut(frame, _holed(frame.mask, share, rng)))


def lost_masks(subject: Subject, share: float, rng: np.random.Generator) -> Material:
    """A share of the frames in which nobody was found; they stay in the clip."""
    frames = subject.material.train
    lost = set(rng.permutation(len(frames))[: round(share * len(frames))].tolist())
    return subject.material.with_train(
        _cut(frame, np.zeros_like(frame.mask)) if index in lost else frame
        for index, frame in enumerate(frames)
    )


def frame_count(subject: Subject, count: float, rng: np.random.Generator) -> Material:
    """So many frames, evenly over the clip."""
    del rng
    frames = subject.material.train
    kept = min(int(count), len(frames))
    places = np.arange(kept) * len(frames) // kept
    return subject.material.with_train(frames[place] for place in places)


def arc_seen(subject: Subject, degrees: float, rng: np.random.Generator) -> Material:
    """Only frames in which the person faces the camera to within half of `degrees`, or the few
    nearest to that which training asks for."""
    del rng
    frames, skeleton = subject.material.train, subject.material.body.skeleton
    sides = np.degrees([abs(side_of_body(frame.camera, frame.pose, skeleton)) for frame in frames])
    kept = np.flatnonzero(sides <= max(0.5 * degrees, np.sort(sides)[LEAST_FRAMES - 1]))
    return subject.material.with_train(frames[place] for place in kept)


def sensor_noise(subject: Subject, levels: float, rng: np.random.Generator) -> Material:
    """Noise of `levels` of 255, at every pixel its own."""
    return _filmed(subject, lambda seen, *_: seen + levels / 255.0 * rng.normal(size=seen.shape))


def exposure_drift(subject: Subject, stops: float, rng: np.random.Generator) -> Material:
    """Exposure goes up and down by `stops` once in a clip."""
    del rng
    return _filmed(
        subject,
        lambda seen, index, count: _exposed(seen, 2.0 ** (stops * _wave(index, count))),
    )


def white_balance_drift(subject: Subject, percent: float, rng: np.random.Generator) -> Material:
    """Red gains, and blue loses, up to `percent` of the light; then the other way round."""
    del rng

    def tinted(seen: Array, index: int, count: int) -> Array:
        gain = 0.01 * percent * _wave(index, count)
        return _exposed(seen, np.array([1.0 + gain, 1.0, 1.0 - gain]))

    return _filmed(subject, tinted)


def dark_scene(subject: Subject, stops: float, rng: np.random.Generator) -> Material:
    """So many stops less light, which the camera makes up for with gain: shot and read noise."""
    light = 2.0**-stops * _FULL_WELL

    def gained(seen: Array, *_: int) -> Array:
        electrons = light * seen**_GAMMA
        noise = np.sqrt(electrons + _READ_NOISE**2) * rng.normal(size=seen.shape)
        return np.clip((electrons + noise) / light, 0.0, 1.0) ** (1.0 / _GAMMA)

    return _filmed(subject, gained if stops else lambda seen, *_: seen)


def compression(subject: Subject, quality: float, rng: np.random.Generator) -> Material:
    """JPEG of that quality; 100 stands for none."""
    del rng
    if quality == 100.0:
        return subject.material
    options = [cv2.IMWRITE_JPEG_QUALITY, int(quality)]

    def compressed(seen: Array, *_: int) -> Array:
        pixels = np.ascontiguousarray((255.0 * seen + 0.5).astype(np.uint8)[..., ::-1])
        read = cv2.imdecode(cv2.imencode(".jpg", pixels, options)[1], cv2.IMREAD_COLOR)
        assert read is not None
        return read[..., ::-1].astype(np.float32) / np.float32(255.0)

    return _filmed(subject, compressed)


def video_compression(subject: Subject, bits: float, rng: np.random.Generator) -> Material:
    """The clip by H.264, in so many bits a pixel; `UNCOMPRESSED_BITS` stands for none."""
    del rng
    if bits == UNCOMPRESSED_BITS:
        return subject.material
    return _as_footage(subject, lambda clip: through_h264(clip, bits))


def resolution(subject: Subject, share: float, rng: np.random.Generator) -> Material:
    """Pictures of a share of the size."""
    del rng

    def small(frame: Frame) -> Frame:
        width, height = (
            max(1, round(share * side)) for side in (frame.camera.width, frame.camera.height)
        )
        image, mask = (
            cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)
            for part in (frame.image, frame.mask)
        )
        return replace(frame, image=image, mask=mask, camera=frame.camera.resized(width, height))

    return _each(subject, small)


def object_in_front(subject: Subject, share: float, rng: np.random.Generator) -> Material:
    """A pole before the middle of the person, so wide that it hides `share` of their width."""
    del rng

    def behind(frame: Frame) -> Frame:
        crop = body_crop(frame.mask, 0.0)
        if crop is None:
            return frame
        left, right = crop[1].start, crop[1].stop
        half, middle = 0.5 * share * (right - left), 0.5 * (left + right)
        mask = frame.mask.copy()
        mask[:, round(middle - half) : round(middle + half)] = 0.0
        return _cut(frame, mask)

    return _each(subject, behind)


def chair_in_mask(subject: Subject, share: float, rng: np.random.Generator) -> Material:
    """A chair's back that is taken for the person: it stands still behind them, and stands out
    beside their trunk by `share` of its width."""
    frames, skeleton = subject.material.train, subject.material.body.skeleton
    spans = [span for frame in frames if (span := _trunk(frame, skeleton)) is not None]
    if not share or not spans:
        return subject.material
    top, bottom, left, right = np.median(spans, axis=0)
    out = share * (right - left)
    chair, cover = _chair_back(frames[0], (top, bottom, right - out, right + out), rng)

    def before_it(frame: Frame) -> Frame:
        beside = (1.0 - frame.mask) * cover
        image = (frame.image + beside[..., None] * chair).astype(np.float32)
        return replace(frame, image=image, mask=(frame.mask + beside).astype(np.float32))

    return _each(subject, before_it)


def cropped_person(subject: Subject, step: float, rng: np.random.Generator) -> Material:
    """Pictures that end at the knees, the waist or the bust, and so does what is judged."""
    del rng
    skeleton = subject.material.body.skeleton
    return subject.material.everywhere(lambda frame: ended_at(frame, skeleton, CROPS[int(step)]))


def ended_at(frame: Frame, skeleton: Skeleton, part: str) -> Frame:
    """`frame` down to `part`, of `CROPS`."""
    rows = rows_until(frame, skeleton, part)
    return replace(
        frame,
        image=np.ascontiguousarray(frame.image[:rows]),
        mask=np.ascontiguousarray(frame.mask[:rows]),
        camera=frame.camera.cropped(0, 0, frame.camera.width, rows),
    )


def rows_until(frame: Frame, skeleton: Skeleton, part: str) -> int:
    """Rows of the picture down to `part`, of `CROPS`."""
    if part not in _CUT_AT:
        return frame.camera.height
    row = _joint_pixels(frame, skeleton, _CUT_AT[part])[:, 1].mean()
    return int(np.clip(row, _LEAST_ROWS, frame.camera.height))


def _joint_pixels(frame: Frame, skeleton: Skeleton, names: tuple[str, ...]) -> Float[Array, "J 2"]:
    joints = [JOINT_NAMES.index(name) for name in names]
    placed = skeleton.joint_transforms(frame.pose.joint_angles, frame.pose.root_translation)
    return frame.camera.project(placed[joints, :3, 3])[0]


def _trunk(frame: Frame, skeleton: Skeleton) -> tuple[int, int, int, int] | None:
    """Rows from the shoulders to the hips, and the columns of the mask between; None where nobody
    is."""
    shoulder, hip = _joint_pixels(frame, skeleton, ("neck", "pelvis"))[:, 1]
    top = int(np.clip(shoulder, 0, frame.camera.height - 2))
    bottom = int(np.clip(hip, top + 1, frame.camera.height))
    columns = np.flatnonzero((frame.mask[top:bottom] > 0.5).any(axis=0))
    return (top, bottom, columns[0], columns[-1] + 1) if len(columns) else None


def _chair_back(
    frame: Frame, sides: tuple[float, float, float, float], rng: np.random.Generator
) -> tuple[Float[Array, "H W 3"], Float[Array, "H W"]]:
    """Upholstery in all of the picture, and how far each pixel lies in the chair's back, whose top,
    bottom, left and right are given, px."""
    top, bottom, left, right = sides
    rows, columns = np.mgrid[: frame.camera.height, : frame.camera.width] + 0.5
    half = np.array([[0.5 * (bottom - top)], [0.5 * (right - left)]])
    away = np.abs([rows.ravel() - 0.5 * (top + bottom), columns.ravel() - 0.5 * (left + right)])
    radius = _ROUNDED * half.min()
    outside = np.maximum(away - half + radius, 0.0)
    cover = np.clip(0.5 - (np.hypot(*outside) - radius), 0.0, 1.0).reshape(rows.shape)
    weave = 1.0 + 0.2 * np.sin(_RIBS * columns / radius) + 0.05 * rng.normal(size=rows.shape)
    return np.clip(weave[..., None] * _UPHOLSTERY, 0.0, 1.0), cover


def _each(subject: Subject, change: Callable[[Frame], Frame]) -> Material:
    return subject.material.with_train(map(change, subject.material.train))


def _filmed(subject: Subject, camera: Camera01) -> Material:
    """Every picture in a room, by `camera`, cut out again: what shines through the soft rim of a
    mask stays in it."""
    return _as_footage(
        subject,
        lambda clip: (camera(whole, index, len(clip)) for index, whole in enumerate(clip)),
    )


def _as_footage(subject: Subject, footage: Footage) -> Material:
    """As `_filmed`, of a camera that sees the whole clip."""
    frames, room = subject.material.train, _room(subject)
    wholes = [frame.image + (1.0 - frame.mask[..., None]) * room for frame in frames]

    def cut_out(frame: Frame, seen: Array) -> Frame:
        shown = np.rint(255.0 * np.clip(seen, 0.0, 1.0)) / 255.0
        return replace(frame, image=(shown * frame.mask[..., None]).astype(np.float32))

    return subject.material.with_train(map(cut_out, frames, footage(wholes)))


def _room(subject: Subject) -> Float[Array, "H W 3"]:
    """Behind the person; the training camera stands still."""
    return room_background(subject.material.train[0].camera, _ROOM_SEED)


def _exposed(seen: Array, gain: float | Array) -> Array:
    return np.clip(gain * seen**_GAMMA, 0.0, 1.0) ** (1.0 / _GAMMA)


def _wave(index: int, count: int) -> float:
    return float(np.sin(2.0 * np.pi * index / count))


def _disc(frame: Frame, px: float) -> Array:
    side = 2 * round(px * frame.camera.height / REFERENCE_PX) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))


def _dilated(frame: Frame, room: Array, px: float) -> Frame:
    mask = cv2.dilate(frame.mask, _disc(frame, px))
    image = frame.image + (mask - frame.mask)[..., None] * room
    return replace(frame, image=image.astype(np.float32), mask=mask)


def _cut(frame: Frame, mask: Float[Array, "H W"]) -> Frame:
    """`frame` by a mask that is no larger than its own."""
    share = np.where(frame.mask > 0.0, mask / np.maximum(frame.mask, 1e-6), 0.0)
    image = (frame.image * share[..., None]).astype(np.float32)
    return replace(frame, image=image, mask=mask.astype(np.float32))


def _holed(mask: Float[Array, "H W"], share: float, rng: np.random.Generator) -> Array:
    crop, whole = body_crop(mask, 0.0), float(mask.sum())
    holed = mask.copy()
    if crop is None:
        return holed
    rows, columns = np.nonzero(mask > 0.5)
    radius = max(1, round(_HOLE_SHARE * (crop[0].stop - crop[0].start)))
    while len(rows) and holed.sum() > (1.0 - share) * whole:
        at = rng.integers(len(rows))
        cv2.circle(holed, (int(columns[at]), int(rows[at])), radius, 0.0, -1)
    return holed
