"""Faces and hands measured: the page's numbers, what they change with, and what they do not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from capture.body.expressions import (
    ALL_GROUPS,
    FACE,
    FACE_NUMBERS,
    GROUPS,
    LEFT_HAND,
    RIGHT_HAND,
    USUAL_REST,
    ObservedExpression,
    face_measures,
    face_numbers,
    finger_curls,
    resting_face,
)
from scene.expression import EXPRESSION_NAMES, FINGERS
from scene.rotations import axis_angle_to_matrix

GOLDEN = Path(__file__).parents[1] / "expressions.json"
"""Made by `python -m tests.capture.body.test_expressions`; the client's tests read it too."""


def face(
    jaw: float = 0.0,
    left: float = 0.0,
    right: float = 0.0,
    brows: float = 0.0,
    smile: float = 0.0,
    aside: float = 0.0,
) -> np.ndarray:
    """A face of 300 px from cheek to cheek: only the points that are measured."""
    points = np.zeros((478, 3))
    points[[234, 454]] = [[-150, 0, 60], [150, 0, 60]]
    points[[33, 133, 362, 263]] = [[-100, -40, 10], [-40, -40, 0], [40, -40, 0], [100, -40, 10]]
    for upper, lower, x, shut in (
        ((160, 159, 158), (144, 145, 153), -70, right),
        ((385, 386, 387), (380, 374, 373), 70, left),
    ):
        half = 8.0 * (1.0 - 0.8 * shut)
        for index, (a, b) in enumerate(zip(upper, lower, strict=True)):
            points[a] = [x + 10 * (index - 1), -40 - half, 0]
            points[b] = [x + 10 * (index - 1), -40 + half, 0]
    upward = np.array([0.0, -200.0, 30.0]) / np.hypot(200.0, 30.0)  # to the forehead
    ahead = np.cross([1.0, 0.0, 0.0], upward)
    off = 0.07 * upward + 0.125 * ahead + [0.23 * aside, 0.0, 0.0]
    points[[468, 473]] = np.hypot(60.0, 10.0) * off + [[-70, -40, 5], [70, -40, 5]]
    points[[65, 52]] = [[-50, -90 - 12 * brows, 0], [-80, -90 - 12 * brows, 0]]
    points[[295, 282]] = [[50, -90 - 12 * brows, 0], [80, -90 - 12 * brows, 0]]
    points[[10, 2]] = [[0, -160, 0], [0, 40, -30]]
    wide, high = 45 + 10 * smile - 8 * jaw, 80 - 14 * smile + 20 * jaw
    points[[61, 291]] = [[-wide, high, 0], [wide, high, 0]]
    points[[13, 14]] = [[0, 78, -10], [0, 80 + 60 * jaw, -10]]
    return points


def hand(*shares: float) -> np.ndarray:
    """A hand, m, whose fingers, thumb first, are bent by shares of what the body model bends them
    from where they are a little bent already (`tools.build_expressions`)."""
    points = np.zeros((21, 3))
    for finger, share in enumerate(shares[1:]):
        place, turned = np.array([0.02 * finger - 0.03, 0.09, 0.0]), 0.0
        points[5 + 4 * finger] = place
        bones = (0.04, 14.0, 55.0), (0.025, 12.0, 75.0), (0.025, 5.0, 45.0)
        for joint, (length, flat, bend) in enumerate(bones, 6):
            turned += np.radians(flat + share * bend)
            place = place + length * np.array([0.0, np.cos(turned), np.sin(turned)])
            points[joint + 4 * finger] = place
    out, across = np.array([-0.08, 0.09, 0.02]), np.array([0.0, 0.07, 0.02])
    tip = out + shares[0] * (across - out)
    points[1:5] = np.linspace(0.0, 1.0, 5)[1:, None] * tip
    return points


def bent(name: str, share: float = 1.0) -> np.ndarray:
    """A hand of which one finger is bent."""
    return hand(*(share * (finger == name) for finger in FINGERS))


def golden() -> dict[str, list]:
    """Points in whole tenths, and what is to be made of them."""
    faces = [face(), face(jaw=0.9), face(left=1.0, right=0.3), face(brows=1.0), face(smile=0.7)]
    faces += [face(aside=0.8), face(aside=-0.5), face()]
    faces = [np.round(turned(one, 0.1 * k), 1) for k, one in enumerate(faces)]
    hands = [hand(*[share] * 5) for share in (0.0, 0.4, 1.0)]
    hands += [bent(name, 0.8) for name in FINGERS]
    hands = [np.round(turned(one, 0.2 * k, 0.3), 4) for k, one in enumerate(hands)]
    measures = np.array([face_measures(one) for one in faces])
    rest = resting_face(measures)
    return {
        "faces": [{str(i): p.tolist() for i, p in enumerate(one) if p.any()} for one in faces],
        "measures": measures.tolist(),
        "rest": rest.tolist(),
        "numbers": [face_numbers(one, rest).tolist() for one in measures],
        "hands": [one.tolist() for one in hands],
        "curls": [finger_curls(one).tolist() for one in hands],
    }


def turned(points: np.ndarray, yaw_rad: float, pitch_rad: float = 0.0) -> np.ndarray:
    by_yaw = axis_angle_to_matrix(np.array([0.0, yaw_rad, 0.0]))
    return points @ (axis_angle_to_matrix(np.array([pitch_rad, 0.0, 0.0])) @ by_yaw).T


def numbers(**shown: float) -> np.ndarray:
    measures, rest = face_measures(face(**shown)), face_measures(face())
    assert measures is not None
    assert rest is not None
    return face_numbers(measures, rest)


def test_the_numbers_are_those_that_pages_are_held_to():
    kept, made = json.loads(GOLDEN.read_text()), golden()
    assert kept.keys() == made.keys()
    for name in kept.keys() - {"faces"}:
        np.testing.assert_allclose(kept[name], made[name], atol=1e-9)
    assert kept["faces"] == made["faces"]


@pytest.mark.parametrize(
    ("name", "number"), [("jaw", 0), ("left", 1), ("right", 2), ("brows", 3), ("smile", 4)]
)
def test_each_number_tells_of_its_own_part_alone(name: str, number: int):
    half, whole = numbers(**{name: 0.5}), numbers(**{name: 1.0})
    assert 0.2 < half[number] < whole[number]
    others = np.delete(whole, number)
    # lids that fall take the brows' distance from them along, as they do on faces
    assert others.max() < (0.2 if name != "left" and name != "right" else 1.01)
    assert not numbers().any()


@pytest.mark.parametrize(("aside", "number"), [(0.6, 5), (-0.6, 6)])
def test_eyes_look_left_and_right_whatever_way_the_face_is_turned(aside: float, number: int):
    """Left is the person's own: to the right in a picture of them."""
    rest = face_measures(face())
    assert rest is not None
    for way in ((0.0, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 0.2)):
        measures = face_measures(0.7 * turned(face(aside=aside), *way) + [90.0, 50.0, 0.0])
        assert measures is not None
        shown = face_numbers(measures, rest)
        assert shown[number] == pytest.approx(0.6, abs=0.03)
        assert np.delete(shown, number).max() < 0.03


def test_who_looks_aside_for_long_is_not_taken_to_look_straight_ahead():
    aside, straight = face_measures(face(aside=1.0)), face_measures(face())
    assert aside is not None
    assert straight is not None
    shown = face_numbers(aside, resting_face(np.array([aside] * 9 + [straight])))
    assert shown[5] == pytest.approx(1.0, abs=1e-6)
    assert not shown[6:].any()


def test_an_eye_that_shuts_is_the_persons_own():
    """A person's right eye is at the left of a picture of them."""
    assert face()[33, 0] < face()[263, 0]
    assert numbers(right=1.0)[2] > 0.9
    assert numbers(right=1.0)[1] == 0.0


@pytest.mark.parametrize("way", [(0.5, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.3, -0.3)])
def test_neither_a_turn_nor_distance_changes_anything(way: tuple[float, float]):
    straight = face_measures(face(jaw=0.4, smile=0.3))
    away = face_measures(0.5 * turned(face(jaw=0.4, smile=0.3), *way) + [200.0, 100.0, 3.0])
    assert straight is not None
    assert away is not None
    np.testing.assert_allclose(away, straight, atol=1e-9)


def test_a_small_face_and_one_that_looks_away_tell_nothing():
    assert face_measures(0.1 * face()) is None
    assert face_measures(turned(face(), 1.0)) is None


def test_the_face_at_rest_is_found_among_talk_and_blinks():
    rng = np.random.default_rng(0)
    shown = [
        face_measures(face(jaw=j, left=b, right=b, smile=s))
        for j, b, s in zip(
            np.clip(rng.normal(0.1, 0.3, 200), 0, 1),
            rng.random(200) < 0.15,
            np.clip(rng.normal(-0.2, 0.4, 200), 0, 1),
            strict=True,
        )
    ]
    rest = face_measures(face())
    assert rest is not None
    np.testing.assert_allclose(resting_face(np.array(shown)), rest, atol=0.02)


@pytest.mark.parametrize("name", FINGERS)
def test_each_finger_curls_by_itself_from_flat_to_a_fist(name: str):
    curls = np.array([finger_curls(bent(name, share)) for share in np.linspace(0.0, 1.0, 11)])
    own = curls[:, FINGERS.index(name)]
    assert (np.diff(own) >= 0.0).all()
    assert own[0] == 0.0
    assert 0.3 < own[5] < 0.65
    assert own[-1] > 0.95
    assert not np.delete(curls, FINGERS.index(name), axis=1).any()


@pytest.mark.parametrize("shares", [(0.0, 0.2, 0.4, 0.6, 0.8), (0.7, 0.0, 1.0, 1.0, 0.3)])
def test_neither_a_turn_nor_the_size_of_a_hand_changes_its_curls(shares: tuple[float, ...]):
    curls = finger_curls(hand(*shares))
    away = 3.0 * turned(hand(*shares), 1.0, 0.7) + [0.3, -0.1, 2.0]
    np.testing.assert_allclose(finger_curls(away), curls, atol=1e-9)
    mirrored = hand(*shares) * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(finger_curls(mirrored), curls, atol=1e-9)


def test_a_hand_of_which_nothing_is_known_has_finite_curls():
    assert np.isfinite(finger_curls(np.zeros((21, 3)))).all()


def test_numbers_belong_to_groups_that_are_seen_together():
    wanted = [FACE] * FACE_NUMBERS + [LEFT_HAND] * 5 + [RIGHT_HAND] * 5
    assert [int(bit) for bit in GROUPS] == wanted
    assert len(USUAL_REST) == FACE_NUMBERS - 1  # eyes look to either side
    known = ObservedExpression(np.zeros(len(EXPRESSION_NAMES)), ALL_GROUPS & ~FACE).known_numbers
    assert known.tolist() == [False] * FACE_NUMBERS + [True] * 10


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps(golden()) + "\n")
