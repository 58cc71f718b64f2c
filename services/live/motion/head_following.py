"""The head as the face's own points show it.

The body's landmarks have eleven points of a head, whose depth is a guess: on webcam clips the head
that is solved from them looks 8 to 25 degrees beside where the face does, and turns with it only
roughly (correlations of 0.3 to 0.7). The face's 478 points tell its rotation within 2 degrees, but
come later, and of every few pictures. So each tells how far the solved head of that very picture is
off; neck and head take half of it each, from then on, smoothed. The page's twin is
`client/src/motion/headFollowing.ts`.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from scene.arrays import Array, Float
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import HEAD, JOINT_NAMES
from services.live.eye_level import head_in_room

_TURNED = [JOINT_NAMES.index("neck"), HEAD]
_SETTLING_S = 0.1
"""Time in which most of a new difference is taken: points scatter by 1 to 2 degrees, and what came
at once would be seen as a jerk."""
_FARTHEST_RAD = math.radians(60.0)
"""No head that is solved is further off: the face is another's, or found wrongly."""
_HELD_S, _EASED_S = 1.5, 1.0
"""How long a difference stands of whom no face is seen, and in what time it then goes."""
_REMEMBERED_S, _SAME_S = 1.5, 0.05
"""How long solved heads are remembered, and how far from a face's time one may be."""


@dataclass(frozen=True, eq=False)
class ObservedHead:
    """A head by its face's points."""

    rotation: Float[Array, "3 3"]
    """From rest to the world of the solver."""
    time_s: float
    """Of the picture."""


class HeadFollowing:
    """One person's; belongs to one thread."""

    def __init__(self) -> None:
        self._solved: deque[tuple[float, Float[Array, "24 3"]]] = deque()
        self._seen_off, self._off = np.zeros(3), np.zeros(3)
        self._seen_s = -math.inf

    def update(
        self, head: ObservedHead | None, angles: Float[Array, "24 3"], time_s: float
    ) -> None:
        """Note joints' angles as solved of the picture of `time_s`, and a head that was seen."""
        step_s = time_s - self._solved[-1][0] if self._solved else math.inf
        self._solved.append((time_s, angles))
        while self._solved[0][0] < time_s - _REMEMBERED_S:
            self._solved.popleft()
        first = self._seen_s == -math.inf
        if head is not None and head.time_s > self._seen_s:
            self._observe(head)
        share = 1.0 if first else 1.0 - math.exp(-step_s / _SETTLING_S)
        self._off = self._off + share * (self._seen_off - self._off)

    def _observe(self, head: ObservedHead) -> None:
        then_s, angles = min(self._solved, key=lambda one: abs(one[0] - head.time_s))
        solved = head_in_room(axis_angle_to_matrix(angles))
        off = matrix_to_axis_angle(solved.T @ head.rotation)
        if abs(then_s - head.time_s) < _SAME_S and np.linalg.norm(off) < _FARTHEST_RAD:
            self._seen_off, self._seen_s = off, head.time_s

    def followed(self, angles: Float[Array, "24 3"], time_s: float) -> Float[Array, "24 3"]:
        """Joints' angles with the head where its face has it at `time_s`."""
        share = min(max(1.0 - (time_s - self._seen_s - _HELD_S) / _EASED_S, 0.0), 1.0)
        if share == 0.0:
            return angles
        off = share * self._off
        neck, head = axis_angle_to_matrix(angles[_TURNED])
        # what the head is off by, in the neck's axes
        turn = axis_angle_to_matrix(0.5 * (head @ off))
        followed = angles.copy()
        followed[_TURNED] = matrix_to_axis_angle(
            np.stack([neck @ turn, turn.T @ head @ axis_angle_to_matrix(off)])
        )
        return followed
