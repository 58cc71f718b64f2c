"""Where performers sit, and from where one looks at first. Nothing else decides either.

Places lie on an arc of 240 degrees round one centre, which everybody faces; further rows behind it
look through its gaps. A place depends on its number alone, so that whoever is there stays where
they are when others come or go. The first three are a third of a circle apart, so that each sees
both others 30 degrees off their front. Whoever only watches stands before the side that is left
open, where nobody turns their back on them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

Point = tuple[float, float, float]
"""World, m."""

_ROW_RADIUS_M, _BETWEEN_ROWS_M = 1.35, 0.9
_ROWS_DEG = (
    (0, 120, 240, 60, 180, 30, 210, 90, 150),
    (15, 225, 105, 135, 45, 195, 75, 165),
)
"""Yaws of a row's places in the order in which they are taken, of even and odd rows."""
_CLOSE_UP_M = 2.2
"""From here somebody is seen from the hips up by a field of view of 0.6 rad."""
_BELOW_EYES_M = 0.28
"""The middle of such a picture."""
_ELEVATION_RAD = 0.08
_REACH_M = 0.45
"""Half of the width that somebody takes up with their arms."""
_FACE_M = 0.12
"""Half of the width of a face, and some air beside it."""
_IN_SIGHT_RAD = math.radians(60.5)
"""Who is to be in one picture: two neighbours of three are 60 degrees apart."""
_SCREEN = 0.5
"""Half of the width, by the distance, of a picture as wide as most screens' (field of view 0.6)."""
_BEHIND_M = 0.45
"""How far behind one's own eyes one stands at most, where one's own head is still left out."""


@dataclass(frozen=True)
class Placed:
    """Somebody in the room: where, facing which way, and how high their eyes are."""

    x_m: float
    z_m: float
    facing_rad: float
    """Yaw about +y; 0 faces +z."""
    eye_height_m: float


@dataclass(frozen=True)
class DefaultViewpoint:
    """From where one looks at first: on an orbit round `target`, as `scene.camera.orbit_camera`."""

    target: Point
    azimuth_rad: float
    elevation_rad: float
    distance_m: float
    """How near one comes at most."""
    width_m: float
    """What is to be in sight at the target; whose picture is too narrow steps back for it."""
    depth_m: float
    """How far behind the target the last one sits."""
    narrow: DefaultViewpoint | None = None
    """What a picture shows instead that would have to step back for the width."""

    def distance_for(self, aspect: float, fov_y_rad: float) -> float:
        """How far away (m) a picture of this aspect (width by height) shows everybody."""
        return max(self.distance_m, self.width_m / (2.0 * math.tan(0.5 * fov_y_rad) * aspect))


NOBODY = DefaultViewpoint((0.0, 1.3, 0.0), 0.0, _ELEVATION_RAD, _CLOSE_UP_M, 2.0 * _REACH_M, 0.0)
"""Of an empty room: before its first place."""


def place(number: int) -> tuple[float, float, float]:
    """x and z (m) of a place, from 0, and the yaw (rad) with which one faces the centre there.

    The first is at the origin and faces +z.
    """
    row = 0
    while number >= len(_ROWS_DEG[row % 2]):
        number -= len(_ROWS_DEG[row % 2])
        row += 1
    yaw_rad = math.radians(_ROWS_DEG[row % 2][number])
    radius = _ROW_RADIUS_M + row * _BETWEEN_ROWS_M
    return -radius * math.sin(yaw_rad), _ROW_RADIUS_M - radius * math.cos(yaw_rad), yaw_rad


def first_free(taken: Sequence[int]) -> int:
    """The number of the first place that nobody has."""
    return next(number for number in range(len(taken) + 1) if number not in taken)


def view_from_the_front(people: Sequence[Placed]) -> DefaultViewpoint:
    """Before everybody, in the middle of the ways in which they face."""
    if not people:
        return NOBODY
    azimuth_rad = _middle([person.facing_rad for person in people])
    forward = math.sin(azimuth_rad), math.cos(azimuth_rad)
    ahead = [p.x_m * forward[0] + p.z_m * forward[1] for p in people]
    aside = [p.x_m * forward[1] - p.z_m * forward[0] for p in people]
    # level with the nearest: whoever sits farther away is in sight where these are
    near, middle = max(ahead), 0.5 * (min(aside) + max(aside))
    height = sum(p.eye_height_m for p in people) / len(people) - _BELOW_EYES_M
    return DefaultViewpoint(
        (
            near * forward[0] + middle * forward[1],
            height,
            near * forward[1] - middle * forward[0],
        ),
        azimuth_rad,
        _ELEVATION_RAD,
        _CLOSE_UP_M,
        max(aside) - min(aside) + 2.0 * _REACH_M,
        near - min(ahead),
    )


def view_from_a_place(me: Placed, others: Sequence[Placed]) -> DefaultViewpoint:
    """From one's own place, towards as many of the others as one picture shows; where it is too
    narrow for them, towards whoever's face is seen best.

    Without others, at oneself from the front.
    """
    if not others:
        return view_from_the_front([me])
    groups = [_beside(me, one, others) for one in others]
    seen = max(groups, key=lambda group: (len(group), -sum(_off_front(p, me) for p in group)))
    view = _towards(me, seen)
    if len(seen) == 1:
        return view
    return replace(view, narrow=_towards(me, [min(seen, key=lambda one: _off_front(one, me))]))


def _towards(me: Placed, seen: Sequence[Placed]) -> DefaultViewpoint:
    """Through one's own eyes, or from behind them where that brings all of `seen` into the picture.

    `seen` runs to the left from its first, so that no bearing jumps from pi to -pi within it.
    """
    first = _bearing(me, seen[0])
    half_rad = 0.5 * max(_wrapped(_bearing(me, p) - first) for p in seen)
    bearing = me.facing_rad + first + half_rad
    ways = [_wrapped(_bearing(me, p) - first) - half_rad for p in seen]
    distances = [math.hypot(p.x_m - me.x_m, p.z_m - me.z_m) for p in seen]
    aside = [d * abs(math.sin(way)) + _FACE_M for d, way in zip(distances, ways, strict=True)]
    ahead = [d * math.cos(way) for d, way in zip(distances, ways, strict=True)]
    short = max(wide / _SCREEN - deep for wide, deep in zip(aside, ahead, strict=True))
    back = min(max(short, 0.0), _BEHIND_M)
    middle = sum(distances) / len(seen)
    distance = middle + back
    height = sum(p.eye_height_m for p in seen) / len(seen) - _BELOW_EYES_M
    above = me.eye_height_m - height
    widest = max(wide / (deep + back) for wide, deep in zip(aside, ahead, strict=True))
    return DefaultViewpoint(
        (me.x_m + middle * math.sin(bearing), height, me.z_m + middle * math.cos(bearing)),
        _wrapped(bearing + math.pi),
        math.atan2(above, distance),
        math.hypot(above, distance),
        2.0 * distance * widest if len(seen) > 1 else 0.0,
        max(distances) - middle,
    )


def _beside(me: Placed, one: Placed, others: Sequence[Placed]) -> list[Placed]:
    """`one`, then those of the others whom `me` sees a little to the left of them."""
    ways = [(_wrapped(_bearing(me, p) - _bearing(me, one)), p) for p in others if p is not one]
    return [one, *(p for way, p in ways if 0.0 <= way <= _IN_SIGHT_RAD)]


def _middle(ways_rad: Sequence[float]) -> float:
    """The middle of the narrowest arc that holds all of these ways."""
    ways = sorted(way % (2.0 * math.pi) for way in ways_rad)
    # rounded, so that of arcs as wide as each other the first is taken on every machine
    widths = [round((ways[i - 1] - way) % (2.0 * math.pi), 6) for i, way in enumerate(ways)]
    width, start = min(zip(widths, ways, strict=True))
    return _wrapped(start + 0.5 * width)


def _off_front(one: Placed, me: Placed) -> float:
    """How far (rad) from the front of `one` their face is seen by `me`."""
    return abs(_bearing(one, me))


def _bearing(me: Placed, other: Placed) -> float:
    """How far (rad) to the left of the way that `me` faces the other is."""
    return _wrapped(math.atan2(other.x_m - me.x_m, other.z_m - me.z_m) - me.facing_rad)


def _wrapped(angle_rad: float) -> float:
    """The same angle between -pi and pi."""
    return math.remainder(angle_rad, 2.0 * math.pi)
