"""Which kind of surface each splat lies on: what no frame shows takes its colour from its kind.

Parts of the body follow from the joints that move them. The scalp is what lies above and behind a
plane that falls at 45 degrees from the hairline to the nape: on the mean body it passes above the
brows, over the ears and below the back of the skull.
"""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Bool, Float, Int
from scene.skeleton import HEAD, JOINT_NAMES, Skeleton

KINDS = ("trunk", "arms", "hands", "legs", "feet", "neck", "face", "scalp")
HEAD_KINDS = [KINDS.index(kind) for kind in ("neck", "face", "scalp")]
_PART_OF = {
    "pelvis": "trunk",
    "spine": "trunk",
    "collar": "trunk",
    "hip": "legs",
    "knee": "legs",
    "ankle": "feet",
    "foot": "feet",
    "neck": "neck",
    "head": "face",
    "shoulder": "arms",
    "elbow": "arms",
    "wrist": "hands",
    "hand": "hands",
}
_PARTS = np.array(
    [KINDS.index(_PART_OF[name.split("_")[-1].rstrip("123")]) for name in JOINT_NAMES]
)
_RISE = 0.25
"""How far above the head's joint the plane passes, as a share of how far its top is above."""
_NAPE = 0.2
"""How far below the head's joint the scalp ends, as a share of how far its top is above."""


def strongest_joints(joints: Array, weights: Float[Array, "N 4"]) -> Array:
    """The joint of `joints` [N 4] that moves each splat most."""
    return np.take_along_axis(joints, weights.argmax(axis=1)[:, None], axis=1)[:, 0]


def surface_kinds(
    rest: Float[Array, "N 3"], joints: Array, weights: Float[Array, "N 4"], skeleton: Skeleton
) -> Int[Array, "N"]:
    """Index into `KINDS` of splats at `rest`, m, that follow `joints` [N 4] by `weights`."""
    kinds = _PARTS[strongest_joints(joints, weights)]
    kinds[_on_scalp(rest, kinds, skeleton)] = KINDS.index("scalp")
    return kinds


def _on_scalp(
    rest: Float[Array, "N 3"], kinds: Int[Array, "N"], skeleton: Skeleton
) -> Bool[Array, "N"]:
    _, up, forward = (rest - skeleton.rest_joints[HEAD]).T
    head = kinds == KINDS.index("face")
    top = up[head].max(initial=0.0)
    above = (up > forward + _RISE * top) & (up > -_NAPE * top)
    return above & (head | (kinds == KINDS.index("neck")))
