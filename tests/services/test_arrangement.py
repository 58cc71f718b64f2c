"""Places: face to face, apart, the same whoever comes; first views: faces, and nobody's back."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.arrangement import (
    NOBODY,
    DefaultViewpoint,
    Placed,
    first_free,
    place,
    view_from_a_place,
    view_from_the_front,
)

FOV_Y_RAD = 0.6
CENTRE = (0.0, 1.35)
taken = st.sets(st.integers(0, 11), min_size=1, max_size=12)
aspects = st.floats(0.4, 3.0)


def people(numbers) -> list[Placed]:
    return [Placed(*place(number), 1.6) for number in sorted(numbers)]


def in_picture(view: DefaultViewpoint, people: list[Placed], aspect: float) -> list[Placed]:
    """Whose whole face a window of this aspect shows, as the page looks at a viewpoint."""
    if view.narrow and view.distance_for(aspect, FOV_Y_RAD) > view.distance_m:
        view = view.narrow
    x, z = eye(view, view.distance_for(aspect, FOV_Y_RAD))
    forward = -math.sin(view.azimuth_rad), -math.cos(view.azimuth_rad)
    inside = []
    for one in people:
        ahead = (one.x_m - x) * forward[0] + (one.z_m - z) * forward[1]
        aside = abs((one.x_m - x) * forward[1] - (one.z_m - z) * forward[0])
        if ahead > 0.0 and aside + 0.06 < aspect * math.tan(0.5 * FOV_Y_RAD) * ahead:
            inside.append(one)
    return inside


def eye(view: DefaultViewpoint, distance_m: float) -> tuple[float, float]:
    """x and z (m) of a viewer so far from the target."""
    away = distance_m * math.cos(view.elevation_rad)
    x, _, z = view.target
    return x + away * math.sin(view.azimuth_rad), z + away * math.cos(view.azimuth_rad)


def off_front_deg(person: Placed, x: float, z: float) -> float:
    """How far from the front of their face somebody is seen from a point."""
    towards = math.atan2(x - person.x_m, z - person.z_m)
    return abs(math.degrees(math.remainder(towards - person.facing_rad, 2.0 * math.pi)))


def test_first_places_are_these():
    places = [tuple(round(value, 3) for value in place(number)) for number in range(6)]
    assert places == [
        (0.0, 0.0, 0.0),
        (-1.169, 2.025, 2.094),
        (1.169, 2.025, 4.189),
        (-1.169, 0.675, 1.047),
        (0.0, 2.7, 3.142),
        (-0.675, 0.181, 0.524),
    ]


def test_one_person_is_seen_from_the_front_from_the_hips_up():
    view = view_from_the_front(people({0}))
    x, z = eye(view, view.distance_for(1.6, FOV_Y_RAD))
    assert off_front_deg(people({0})[0], x, z) == pytest.approx(0.0, abs=1e-9)
    half = view.distance_m * math.tan(0.5 * FOV_Y_RAD)
    low, high = view.target[1] - half, view.target[1] + half
    assert 0.6 < low < 0.9
    assert 1.85 < high < 2.1


def test_two_people_see_each_other_thirty_degrees_off_their_front():
    first, second = people({0, 1})
    for me, other in ((first, second), (second, first)):
        view = view_from_a_place(me, [other])
        assert eye(view, view.distance_m) == pytest.approx((me.x_m, me.z_m))
        assert off_front_deg(other, me.x_m, me.z_m) == pytest.approx(30.0)


def test_one_looks_through_ones_own_eyes():
    me, other = Placed(*place(1), 1.43), Placed(*place(0), 1.7)
    view = view_from_a_place(me, [other])
    assert view.target[1] + view.distance_m * math.sin(view.elevation_rad) == pytest.approx(1.43)


def test_alone_one_sees_oneself_from_the_front():
    (me,) = people({3})
    assert view_from_a_place(me, []) == view_from_the_front([me])


def test_an_empty_room_is_seen_from_where_its_first_place_is():
    (first,) = people({0})
    empty, one = view_from_the_front([]), view_from_the_front([first])
    assert empty is NOBODY
    assert (empty.azimuth_rad, empty.distance_m) == (one.azimuth_rad, one.distance_m)


@given(taken)
def test_who_comes_takes_the_first_place_that_is_free(numbers):
    number = first_free(sorted(numbers))
    assert number not in numbers
    assert set(range(number)) <= numbers


@given(st.integers(0, 30))
def test_everybody_faces_the_centre(number):
    x, z, yaw = place(number)
    assert off_front_deg(Placed(x, z, yaw, 1.6), *CENTRE) < 1e-6


def test_nobody_is_nearer_to_another_than_a_chair_is_wide():
    cast = people(range(12))
    for number, one in enumerate(cast):
        for other in cast[:number]:
            assert math.hypot(one.x_m - other.x_m, one.z_m - other.z_m) > 0.65


def test_three_see_both_others_thirty_degrees_off_their_front_in_one_picture():
    cast = people({0, 1, 2})
    for me in cast:
        others = [one for one in cast if one is not me]
        assert [off_front_deg(one, me.x_m, me.z_m) for one in others] == pytest.approx([30.0, 30.0])
        view = view_from_a_place(me, others)
        assert in_picture(view, others, 16 / 9) == others
        # with some air beside their faces, which a narrower window has not: it shows one of them
        assert view.distance_for(16 / 9, FOV_Y_RAD) == view.distance_m
        assert view.distance_for(1400 / 850, FOV_Y_RAD) > view.distance_m
        assert view.narrow is not None
        assert len(in_picture(view.narrow, others, 1400 / 850)) == 1


@given(st.sets(st.integers(0, 8), min_size=2, max_size=9))
def test_nobody_in_the_first_row_turns_their_back_on_another(numbers):
    for me in (cast := people(numbers)):
        for one in cast:
            assert one is me or off_front_deg(one, me.x_m, me.z_m) <= 75.1


@given(taken, aspects)
def test_watchers_see_nobody_from_behind_and_everybody_in_the_picture(numbers, aspect):
    cast = people(numbers)
    view = view_from_the_front(cast)
    x, z = eye(view, view.distance_for(aspect, FOV_Y_RAD))
    assert max(off_front_deg(one, x, z) for one in cast) <= 120.0
    assert in_picture(view, cast, aspect) == cast


@pytest.mark.parametrize("numbers", [{0}, {0, 1}, {1, 2}, {0, 2}])
def test_watchers_of_two_see_both_faces_from_either_side_of_the_room(numbers):
    cast = people(numbers)
    view = view_from_the_front(cast)
    x, z = eye(view, view.distance_for(0.4, FOV_Y_RAD))
    assert max(off_front_deg(one, x, z) for one in cast) <= 60.0


@given(st.sets(st.integers(0, 11), min_size=2, max_size=12), aspects)
def test_from_behind_ones_own_eyes_one_sees_somebody_however_narrow_the_window(numbers, aspect):
    for me in (cast := people(numbers)):
        others = [one for one in cast if one is not me]
        view = view_from_a_place(me, others)
        x, z = eye(view, view.distance_m)
        assert math.hypot(x - me.x_m, z - me.z_m) <= 0.45 + 1e-9
        assert in_picture(view, others, aspect)


@pytest.mark.parametrize(("count", "seen"), [(2, [1, 1]), (3, [2, 2, 2]), (5, [3, 2, 3, 3, 3])])
def test_as_many_of_the_others_are_seen_as_one_picture_shows(count, seen):
    cast = people(range(count))
    for number, (me, expected) in enumerate(zip(cast, seen, strict=True)):
        others = cast[:number] + cast[number + 1 :]
        view = view_from_a_place(me, others)
        assert len(in_picture(view, others, 1.7)) == expected
        (one,) = in_picture(view, others, 0.46)
        best = min(off_front_deg(other, me.x_m, me.z_m) for other in in_picture(view, others, 1.7))
        assert off_front_deg(one, me.x_m, me.z_m) == pytest.approx(best)
