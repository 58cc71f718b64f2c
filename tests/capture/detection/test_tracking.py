"""Following one person: the largest, most central one, through losses, past others, over cuts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from capture.detection.landmarks import Landmarks
from capture.detection.tracking import find_takes, overlap, prominence, track_person, window
from capture.errors import CaptureStopped, NoPersonFound
from tests.capture.people import FakeEstimator, body, camera, picture, seen_by, standing

SUBJECT, OTHER = (200, 60, 40), (40, 200, 60)


@pytest.fixture(scope="module")
def subject() -> list[Landmarks]:
    person, view, motion = body(), camera(), standing(8)
    return [seen_by(view, person, motion.pose(i)) for i in range(8)]


def _beside(person: Landmarks, shift: int, scale: float = 0.5) -> Landmarks:
    """The same person, smaller and `shift` px to the right, feet on the same line."""
    size = len(person.mask)
    height = round(size * scale)
    step = round(1.0 / scale)
    small = person.mask[::step, ::step][:height, :height]
    mask = np.zeros_like(person.mask)
    top = size - height
    left = (size - height) // 2 + shift
    lo, hi = max(0, left), min(size, left + height)
    mask[top:, lo:hi] = small[:, lo - left : hi - left]
    return replace(person, pixels=person.pixels * scale + [left, top], mask=mask)


def _film(subject: list[Landmarks], others: list[Landmarks] | None = None) -> list[np.ndarray]:
    images = [picture(person, SUBJECT) for person in subject]
    for image, other in zip(images, others or [], strict=False):
        image[other.mask > 0.5] = OTHER
    return images


def test_the_person_is_found_in_every_frame_where_they_are(subject):
    track = track_person(_film(subject), FakeEstimator({SUBJECT: subject}))
    assert track.found.all()
    for person, truth in zip(track.people, subject, strict=True):
        assert person is not None
        assert person.mask.shape == truth.mask.shape
        assert (person.mask > 0.5).sum() == pytest.approx((truth.mask > 0.5).sum())
        assert person.pixels[:, 1] == pytest.approx(truth.pixels[:, 1], abs=3)


def test_smaller_people_aside_are_not_followed(subject):
    others = [_beside(person, 70) for person in subject]
    estimator = FakeEstimator({OTHER: others, SUBJECT: subject})
    track = track_person(_film(subject, others), estimator)
    for person, truth in zip(track.people, subject, strict=True):
        assert person is not None
        assert person.box == pytest.approx(truth.box, abs=6)


def test_a_lost_person_is_marked_and_found_again_not_replaced(subject):
    others = [_beside(person, 70) for person in subject]
    images = _film(subject, others)
    for index in (3, 4):
        images[index][(images[index] == SUBJECT).all(axis=2)] = 120
    track = track_person(images, FakeEstimator({SUBJECT: subject, OTHER: others}))
    assert track.found.tolist() == [True] * 3 + [False] * 2 + [True] * 3


class _Stumbling:
    """Finds the person, but sees half of them in place of all the first time that frame comes."""

    def __init__(self, inner: FakeEstimator, stumbles_at: int) -> None:
        self._inner, self._looks_left = inner, stumbles_at

    def detect(self, image: np.ndarray) -> list[Landmarks]:
        found = self._inner.detect(image)
        self._looks_left -= 1
        if self._looks_left != 0:
            return found
        top = [person.pixels[:, 1].min() for person in found]
        return [
            replace(person, pixels=person.pixels * [1.0, 0.5] + [0.0, 0.5 * y])
            for person, y in zip(found, top, strict=True)
        ]


def test_whom_the_estimator_halves_is_looked_at_again(subject):
    looks_to_choose = len(subject)
    estimator = _Stumbling(FakeEstimator({SUBJECT: subject}), looks_to_choose + 3)
    track = track_person(_film(subject), estimator)
    for person, truth in zip(track.people, subject, strict=True):
        assert person is not None
        assert person.box == pytest.approx(truth.box, abs=6)


class _OneAtATime:
    """Finds one person in each picture, and somebody else before the subject."""

    def __init__(self, inner: FakeEstimator) -> None:
        self._inner = inner

    def detect(self, image: np.ndarray) -> list[Landmarks]:
        found = self._inner.detect(image)
        others = [p for p in found if tuple(image[p.mask > 0.5][0]) == OTHER]
        return (others or found)[:1]


def test_whom_a_passer_by_hides_from_the_estimator_is_seen_once_they_are_painted_over(subject):
    others = [_beside(person, 30, 1.0) for person in subject]
    images = _film(subject)
    for index in (3, 4, 5):  # as tall as the subject, and half over them
        images[index][others[index].mask > 0.5] = OTHER
    track = track_person(images, _OneAtATime(FakeEstimator({SUBJECT: subject, OTHER: others})))
    assert track.found.all()
    for index, person in enumerate(track.people):
        assert person is not None
        assert (images[index][person.mask > 0.5] == SUBJECT).all(axis=1).mean() > 0.98


def test_a_new_take_may_be_of_another_light(subject):
    dark = (70, 20, 15)
    images = [picture(person, SUBJECT) for person in subject[:4]]
    images += [picture(person, dark) // 2 for person in subject[4:]]
    told = {SUBJECT: subject, tuple(c // 2 for c in dark): subject}
    track = track_person(images, FakeEstimator(told))
    assert set(track.takes) == {0, 1}
    assert track.found.all()


@pytest.mark.parametrize("near_first", [True, False])
def test_a_new_take_may_be_from_far_nearer_or_farther(subject, near_first: bool):
    """As a guided enrolment's, whose first recordings are of a face and the next of a body."""
    far = [_beside(person, 30, 0.25) for person in subject]
    takes = [subject, far] if near_first else [far, subject]
    images = [_film(take) for take in takes]
    images[1] = [np.where(image == 120, np.uint8(60), image) for image in images[1]]
    track = track_person(images[0] + images[1], FakeEstimator({SUBJECT: [*subject, *far]}))
    assert set(track.takes) == {0, 1}
    assert track.found.all()
    for person, truth in zip(track.people, takes[0] + takes[1], strict=True):
        assert person is not None
        assert overlap(person.box, truth.box) > 0.5


def test_frames_are_looked_at_in_a_window(subject):
    small = [_beside(person, 0) for person in subject]
    estimator = FakeEstimator({SUBJECT: small})
    track_person(_film(small), estimator)
    whole = len(subject[0].mask)
    assert min(width for width, _ in estimator.sizes) < 0.8 * whole


def test_nobody_is_refused_with_advice(subject):
    images = [np.full((64, 64, 3), 120, dtype=np.uint8)] * 4
    with pytest.raises(NoPersonFound, match=r"got nobody in 4 frames.*film one person"):
        track_person(images, FakeEstimator({SUBJECT: subject}))


def test_a_tiny_person_is_refused_with_the_size(subject):
    tiny = [replace(p, pixels=p.pixels * 0.1, mask=p.mask) for p in subject]

    class Tiny:
        def detect(self, image):
            return [tiny[0]]

    with pytest.raises(NoPersonFound, match=r"at least 40 px tall.*come closer"):
        track_person(_film(subject), Tiny())


def test_following_stops_when_asked(subject):
    with pytest.raises(CaptureStopped):
        track_person(_film(subject), FakeEstimator({SUBJECT: subject}), should_stop=lambda: True)


def test_progress_reaches_the_end(subject):
    told: list[float] = []
    track_person(_film(subject), FakeEstimator({SUBJECT: subject}), on_progress=told.append)
    assert told[-1] == pytest.approx(1.0)


def test_takes_are_cut_where_the_picture_jumps():
    calm = [np.full((32, 32, 3), 100 + i, dtype=np.uint8) for i in range(5)]
    other = [np.full((32, 32, 3), 180 + i, dtype=np.uint8) for i in range(5)]
    assert find_takes([*calm, *other]).tolist() == [0] * 5 + [1] * 5
    assert find_takes(calm).tolist() == [0] * 5
    assert find_takes(calm[:1]).tolist() == [0]


def test_a_steady_pan_is_no_cut():
    pan = [np.full((32, 32, 3), 20 * i, dtype=np.uint8) for i in range(10)]
    assert find_takes(pan).max() == 0


def test_prominence_likes_large_and_central(subject):
    size = len(subject[0].mask)
    central, small = prominence(subject[0], size, size), _beside(subject[0], 0)
    assert central > prominence(small, size, size) > prominence(_beside(small, 60, 1.0), size, size)


def test_overlap_of_boxes():
    a = np.array([0.0, 0.0, 2.0, 2.0])
    assert overlap(a, a) == pytest.approx(1.0)
    assert overlap(a, a + 1.0) == pytest.approx(1.0 / 7.0)
    assert overlap(a, a + 5.0) == 0.0


def test_the_window_stays_in_the_picture():
    box = np.array([10.0, 20.0, 50.0, 100.0])
    assert window(box, 200, 110, grow=0.5) == (0, 0, 90, 110)
