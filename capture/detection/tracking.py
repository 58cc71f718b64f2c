"""Tracks one person through a clip: the largest, most central one, never a passer-by.

The subject is chosen once, from a sample of the whole clip. From the frame that shows them best
they are tracked forwards and backwards: each frame is searched in a window around the last box, so
that the person fills the estimator's small input. Other people are rejected by the colours of their
clothes (`capture.detection.appearance`): where only they are detected, their masks are painted over
and the estimator runs again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from capture.detection.appearance import SAME_PERSON, Appearance
from capture.detection.landmarks import Landmarks, PoseEstimator
from capture.errors import CaptureStopped, NoPersonFound
from scene.arrays import Array, Bool, Float, UInt8

SAMPLES = 9
"""Whole frames searched to choose the subject."""
WINDOW_GROW = 0.45
"""The window around the last box, grown by this share of its larger side on every side."""
MIN_OVERLAP = 0.2
"""Intersection over union with the last box below which it is another person."""
MIN_SIDE_PX = 40
"""A smaller person cannot be trained on."""
_LOST_AFTER = 3
"""Frames without the person after which the whole picture is searched again."""
_HISTORY_FRAMES = 9
"""Previous boxes whose median gives the person's typical size."""
_SHRUNK_SHARE = 0.85
"""Share of that size below which a frame is searched again."""
_RETRY_GROWS = (0.15, 0.7)
_MAX_DETECTIONS = 3
"""Detections in a window at most, each with the other people found so far painted over."""
_MASK_THRESHOLD, _GREY = 0.3, 128
"""Alpha from which another person is painted over, and the grey level."""
_CUT_CHANGE = 0.03
_CUT_RATIO = 5.0


@dataclass(frozen=True, eq=False)
class Track:
    """One person through a clip."""

    people: tuple[Landmarks | None, ...]
    """The person in each frame; None where they were lost."""
    takes: tuple[int, ...]
    """Take number of each frame: both picture and person may jump between takes."""

    @property
    def found(self) -> Bool[Array, "F"]:
        """Whether the person was found, for each frame."""
        return np.array([person is not None for person in self.people], dtype=bool)


def track_person(
    images: Sequence[UInt8[Array, "H W 3"]],
    estimator: PoseEstimator,
    *,
    on_found: Callable[[int, Landmarks], object] = lambda *_: None,
    on_progress: Callable[[float], None] = lambda _: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Track:
    """Follow the largest, most central person; `on_found` hears at once of each frame with them.

    Raises NoPersonFound if the sampled frames show nobody large enough, CaptureStopped when asked.
    """
    start, first = _select_subject(images, estimator)
    takes = find_takes(images)
    people: list[Landmarks | None] = [None] * len(images)
    people[start] = first
    on_found(start, first)
    done = 0
    for order in (range(start + 1, len(images)), range(start - 1, -1, -1)):
        for index, person in _follow(images, takes, estimator, (start, *order), first):
            if should_stop():
                raise CaptureStopped("capture was stopped while following the person")
            people[index] = person
            if person is not None:
                on_found(index, person)
            done += 1
            on_progress(done / max(len(images) - 1, 1))
    return Track(tuple(people), tuple(takes.tolist()))


def find_takes(images: Sequence[UInt8[Array, "H W 3"]]) -> Array:
    """Take number of each frame [F]: a new take begins where the picture jumps.

    A jump changes the small, grey picture by more than 3 % of full scale and five times as much as
    a usual step of the clip does.
    """
    small = np.stack(
        [cv2.resize(image, (32, 32), interpolation=cv2.INTER_AREA).mean(axis=2) for image in images]
    )
    change = np.abs(np.diff(small, axis=0)).mean(axis=(1, 2)) / 255.0
    typical_change = float(np.median(change)) if len(change) else 0.0
    cuts = (change > _CUT_CHANGE) & (change > _CUT_RATIO * typical_change)
    return np.concatenate([[0], np.cumsum(cuts)]).astype(int)


def prominence(person: Landmarks, width: int, height: int) -> float:
    """How likely this is the subject: seen area, less with distance from the middle."""
    left, top, right, bottom = np.clip(person.box, 0, [width, height, width, height])
    area = max(right - left, 0.0) * max(bottom - top, 0.0) / (width * height)
    distance = np.hypot((left + right) / width - 1.0, 0.5 * ((top + bottom) / height - 1.0))
    return float(np.sqrt(area) * np.exp(-0.7 * distance) * (0.3 + 0.7 * person.visibility.mean()))


def overlap(a: Float[Array, "4"], b: Float[Array, "4"]) -> float:
    """Intersection over union of two boxes (left, top, right, bottom)."""
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    intersection = float(np.prod(np.maximum(sides, 0.0)))
    areas = [float(np.prod(np.maximum(box[2:] - box[:2], 0.0))) for box in (a, b)]
    return intersection / max(sum(areas) - intersection, 1e-9)


def _select_subject(images: Sequence[Array], estimator: PoseEstimator) -> tuple[int, Landmarks]:
    height, width = images[0].shape[:2]
    sampled = np.unique(np.linspace(0, len(images) - 1, min(SAMPLES, len(images))).astype(int))
    best: tuple[float, int, Landmarks] | None = None
    for index in sampled:
        for person in estimator.detect(images[index]):
            score = prominence(person, width, height)
            if best is None or score > best[0]:
                best = (score, int(index), person)
    if best is None:
        raise NoPersonFound(
            f"the clip must show a person; got nobody in {len(sampled)} frames spread over it; "
            "film one person, well lit, from head to foot or to the hips"
        )
    size = float((best[2].box[2:] - best[2].box[:2]).max())
    if size < MIN_SIDE_PX:
        raise NoPersonFound(
            f"the person must be at least {MIN_SIDE_PX} px tall in a picture of {width} x {height};"
            f" got {size:.0f} px; come closer to the camera"
        )
    return best[1], best[2]


def _follow(
    images: Sequence[Array],
    takes: Array,
    estimator: PoseEstimator,
    order: Sequence[int],
    first: Landmarks,
) -> Iterable[tuple[int, Landmarks | None]]:
    """The person in the frames `order` but for its first, which shows `first`."""
    boxes, missed, elsewhere = deque([first.box], maxlen=_HISTORY_FRAMES), 0, False
    appearance = Appearance()
    appearance.update(images[order[0]], first)
    for before, index in pairwise(order):
        if takes[index] != takes[before]:
            # lighting and visible clothes may differ, and where they are and how near
            appearance, elsewhere = Appearance(), True
        search = _FrameSearch(images[index], estimator, appearance)
        person = search.most_prominent() if elsewhere else None
        if person is not None:
            boxes.clear()
        else:
            person = search.in_window(boxes[-1], whole=missed >= _LOST_AFTER)
            typical_side = float(np.median([_larger_side(box) for box in boxes]))
            if person is not None and _larger_side(person.box) < _SHRUNK_SHARE * typical_side:
                person = search.retry(boxes, person)
        if person is None:
            missed += 1
        else:
            boxes.append(person.box)
            appearance.update(images[index], person)
            missed, elsewhere = 0, False
        yield index, person


@dataclass(frozen=True, eq=False)
class _FrameSearch:
    """Searches one frame for one person."""

    image: UInt8[Array, "H W 3"]
    estimator: PoseEstimator
    appearance: Appearance

    def most_prominent(self) -> Landmarks | None:
        """Of the people in the whole frame."""
        height, width = self.image.shape[:2]
        found = self._detect_same_person(0, 0, width, height)
        return max(found, key=lambda p: prominence(p, width, height), default=None)

    def in_window(self, box: Array, *, whole: bool, grow: float = WINDOW_GROW) -> Landmarks | None:
        """The person in a window around `box`, or in the `whole` frame."""
        if whole:  # lost for long: the most prominent one of a plausible size
            person = self.most_prominent()
            if person is None or person.box[3] - person.box[1] <= 0.4 * (box[3] - box[1]):
                return None
            return person
        height, width = self.image.shape[:2]
        x0, y0, x1, y1 = window(box, width, height, grow)
        if x1 - x0 < MIN_SIDE_PX or y1 - y0 < MIN_SIDE_PX:
            return None
        found = self._detect_same_person(x0, y0, x1, y1)
        person = max(found, key=lambda p: overlap(p.box, box), default=None)
        return person if person and overlap(person.box, box) >= MIN_OVERLAP else None

    def retry(self, boxes: Iterable[Array], person: Landmarks) -> Landmarks:
        """The person by other windows around their recent boxes; the largest detection is kept.

        Estimators sometimes fit a whole body into half of it, which a slightly larger or smaller
        window avoids; otherwise the next window, cropped to half a body, would be worse.
        """
        recent = np.stack(list(boxes))
        union = np.concatenate([recent[:, :2].min(axis=0), recent[:, 2:].max(axis=0)])
        retries = (self.in_window(union, whole=False, grow=grow) for grow in _RETRY_GROWS)
        return max(
            (person, *(other for other in retries if other)), key=lambda p: _larger_side(p.box)
        )

    def _detect_same_person(self, x0: int, y0: int, x1: int, y1: int) -> list[Landmarks]:
        """People in a window whose appearance matches the person's."""
        height, width = self.image.shape[:2]
        crop = self.image[y0:y1, x0:x1]
        for _ in range(_MAX_DETECTIONS):
            found = self.estimator.detect(crop)
            same = [p for p in found if self.appearance.similarity(crop, p) >= SAME_PERSON]
            if same or not found:
                return [person.moved(x0, y0, width, height) for person in same]
            crop = crop.copy()
            crop[np.max([person.mask for person in found], axis=0) > _MASK_THRESHOLD] = _GREY
        return []


def _larger_side(box: Float[Array, "4"]) -> float:
    return float((box[2:] - box[:2]).max())


def window(
    box: Float[Array, "4"], width: int, height: int, grow: float = WINDOW_GROW
) -> tuple[int, int, int, int]:
    """The box grown by `grow` of its larger side on every side, inside the picture."""
    margin = grow * float((box[2:] - box[:2]).max())
    low = np.floor(np.maximum(box[:2] - margin, 0.0)).astype(int)
    high = np.ceil(np.minimum(box[2:] + margin, [width, height])).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])
