"""How head and palms are turned, from landmarks whose rotation is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.detection.face_and_hands import ClipParts, FoundHand, PartLandmarks
from capture.detection.rigid_parts import (
    HEAD_MIRROR,
    HEAD_POINTS,
    PARTS,
    best_rotation,
    rest_points,
    rigid_parts,
)
from scene.arrays import Array, Float
from scene.rotations import axis_angle_to_matrix

FOCAL_PX, CENTRE = 600.0, np.array([320.0, 240.0])
TO_OPENCV = np.array([1.0, -1.0, -1.0])
ANGLES = st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array)


def seen_hand(
    rotation: Float[Array, "3 3"], middle_px: Float[Array, "2"], palm_px: float = 40.0
) -> PartLandmarks:
    """A left hand whose palm is turned by `rotation` where its line of sight meets it."""
    points = np.zeros((21, 3))
    points[[0, 5, 9, 13, 17]] = (rest_points("left_wrist") @ rotation.T) * TO_OPENCV
    pixels = np.tile(middle_px, (21, 1))
    pixels[[0, 9], 1] += [-0.5 * palm_px, 0.5 * palm_px]
    return PartLandmarks(pixels, points)


def seen_clip(hand: PartLandmarks, *, agreed: bool = True) -> ClipParts:
    return ClipParts([None], ([FoundHand(hand, agreed)], [None]))


@settings(max_examples=30)
@given(ANGLES)
def test_a_palm_before_the_camera_is_turned_as_it_is(angles):
    rotation = axis_angle_to_matrix(angles)
    found = rigid_parts(seen_clip(seen_hand(rotation, CENTRE)), FOCAL_PX, CENTRE)
    assert found.rotations[0, 1] == pytest.approx(rotation, abs=1e-6)
    assert found.found.tolist() == [[False, True, False]] == found.turned.tolist()


def test_at_the_side_of_the_picture_the_line_of_sight_counts():
    """A hand that looks straight on, 45 degrees to the right, has turned by as much."""
    at = CENTRE + np.array([FOCAL_PX, 0.0])
    found = rigid_parts(seen_clip(seen_hand(np.eye(3), at)), FOCAL_PX, CENTRE)
    turned = axis_angle_to_matrix(np.array([0.0, -np.pi / 4.0, 0.0]))
    assert found.rotations[0, 1] == pytest.approx(turned, abs=1e-6)
    assert found.middles_px[0, 1] == pytest.approx(at)


def test_a_hand_taken_for_the_other_side_keeps_its_place_alone():
    found = rigid_parts(seen_clip(seen_hand(np.eye(3), CENTRE), agreed=False), FOCAL_PX, CENTRE)
    assert found.found[0, 1]
    assert not found.turned[0, 1]
    assert not found.palms_found[0, 0]


def test_a_small_hand_keeps_its_points_alone():
    small = seen_hand(np.eye(3), CENTRE, palm_px=20.0)
    found = rigid_parts(seen_clip(small), FOCAL_PX, CENTRE)
    assert found.found[0, 1]
    assert found.palms_found[0, 0]
    assert not found.turned[0, 1]


def test_wrist_and_knuckles_are_where_they_were_seen():
    hand = seen_hand(np.eye(3), CENTRE)
    found = rigid_parts(seen_clip(hand), FOCAL_PX, CENTRE)
    assert found.palms_found.tolist() == [[True, False]]
    assert found.palms_px[0, 0] == pytest.approx(hand.pixels[[0, 5, 9, 13, 17]])


def test_points_of_the_head_and_palms_mirror_each_other():
    head = rest_points("head")
    assert head.shape == (len(HEAD_POINTS), 3)
    assert head[list(HEAD_MIRROR)] * [-1.0, 1.0, 1.0] == pytest.approx(head, abs=1e-6)
    assert rest_points(PARTS[1]) * [-1.0, 1.0, 1.0] == pytest.approx(rest_points(PARTS[2]))
    # the corners of the eyes lie below the forehead and before the temples
    at = {point: head[place] for place, point in enumerate(HEAD_POINTS)}
    assert at[10][1] > at[33][1]
    assert at[133][2] > at[127][2]


@settings(max_examples=30)
@given(ANGLES, st.floats(0.1, 500.0))
def test_the_best_rotation_is_the_same_at_every_scale(angles, scale):
    rotation, points = axis_angle_to_matrix(angles), rest_points("head")
    assert best_rotation(points, scale * points @ rotation.T) == pytest.approx(rotation, abs=1e-6)
