"""Which splats a forearm or a hand hides in a frame, and may hide if its pose is a little off.

What is in front of the body teaches nothing to what is behind it: pixels of a hand whose pose is a
few centimetres off fall on the chest, and would stay there as skin-coloured spots.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import ALPHA, EMPTY_BOX, MEAN_X, MEAN_Y
from renderer.splats.rasteriser.workspace import Workspace
from renderer.splats.training.surface_kinds import strongest_joints
from scene.arrays import Array, Bool, Float, Int
from scene.skeleton import JOINT_NAMES

_FRONT_JOINTS = [
    index for index, name in enumerate(JOINT_NAMES) if name.endswith(("elbow", "wrist", "hand"))
]
_CELL_PX = 4
_MARGIN_M = 0.015
"""How far beside its place a hand may be: what errors of captured poses come to."""
_BEHIND_M = 0.04
"""How much farther away a splat must be to count as hidden: a sleeve's own is not."""
_THROUGH_M = 0.14
"""How much farther away than the nearest a splat must be to lie on the other side of the body: more
than a surface that is seen at a slant falls away in a cell."""
_OPAQUE = 0.2


def limb_splats(joints: Array, weights: Array) -> Bool[Array, "N"]:
    """Those that move most with a forearm, wrist or hand; arguments as of `FirstSplats`."""
    return np.isin(strongest_joints(joints, weights), _FRONT_JOINTS)


def hidden_by_limbs(
    work: Workspace, limbs: Bool[Array, "N"], size: tuple[int, int], focal_px: float
) -> Bool[Array, "N"]:
    """The splats behind `limbs` in the picture, `size` (height, width) px, that `work` arranged."""
    from scipy.ndimage import grey_erosion

    drawn = work.boxes[:, 0] != EMPTY_BOX
    front = np.flatnonzero(limbs & drawn & (work.projected[:, ALPHA] > _OPAQUE))
    if not len(front):
        return np.zeros(len(limbs), bool)
    cells, nearest = _nearest(work, front, size)
    margin_px = _MARGIN_M * focal_px / float(np.median(work.depth[front]))
    reach = 1 + 2 * max(1, round(margin_px / _CELL_PX))
    nearest = grey_erosion(nearest, size=(reach, reach), mode="nearest")
    return ~limbs & drawn & (work.depth > nearest[cells] + _BEHIND_M)


def hidden_by_body(
    work: Workspace, limbs: Bool[Array, "N"], size: tuple[int, int]
) -> Bool[Array, "N"]:
    """The splats that lie through head or trunk, whatever is not of `limbs`, from the camera, in
    the picture, `size` (height, width) px, that `work` arranged.

    Splats in front of them let a fifth of the light through, so that blending alone takes a back
    for something that is seen.
    """
    drawn = work.boxes[:, 0] != EMPTY_BOX
    front = np.flatnonzero(~limbs & drawn & (work.projected[:, ALPHA] > _OPAQUE))
    if not len(front):
        return np.zeros(len(limbs), bool)
    cells, nearest = _nearest(work, front, size)
    return drawn & (work.depth > nearest[cells] + _THROUGH_M)


def _nearest(
    work: Workspace, front: Int[Array, "F"], size: tuple[int, int]
) -> tuple[tuple[Int[Array, "N"], Int[Array, "N"]], Float[Array, "h w"]]:
    """Row and column of each splat's cell, and how near (m) the nearest of `front` is in each."""
    p = work.projected
    height, width = (-(-side // _CELL_PX) for side in size)
    column = np.clip((p[:, MEAN_X] / _CELL_PX).astype(np.int32), 0, width - 1)
    row = np.clip((p[:, MEAN_Y] / _CELL_PX).astype(np.int32), 0, height - 1)
    nearest = np.full((height, width), np.inf, np.float32)
    np.minimum.at(nearest, (row[front], column[front]), work.depth[front])
    return (row, column), nearest
