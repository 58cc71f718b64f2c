"""A dressed figure in a T-pose: primitives blended into one surface, skinned by their bones.

Metres, y up, facing +z, the left hand at +x. The pelvis is not at the origin and no sole at y = 0,
as in SMPL's data. The surface is found on a grid by surface nets (Gibson 1998).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TREE = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)
"""Parent of each of SMPL's 24 joints."""
_LEFT_AND_MIDDLE = {
    0: (0.0, -0.235, 0.025),
    1: (0.066, -0.325, 0.018),
    3: (0.0, -0.118, -0.002),
    4: (0.108, -0.705, 0.012),
    6: (0.0, 0.018, 0.0),
    7: (0.092, -1.112, -0.028),
    9: (0.0, 0.072, 0.026),
    10: (0.116, -1.168, 0.092),
    12: (0.0, 0.284, -0.014),
    13: (0.079, 0.193, 0.0),
    15: (0.0, 0.366, 0.034),
    16: (0.186, 0.222, -0.014),
    18: (0.446, 0.216, -0.036),
    20: (0.700, 0.222, -0.036),
    22: (0.784, 0.216, -0.048),
}
_OTHER_SIDE = {1: 2, 4: 5, 7: 8, 10: 11, 13: 14, 16: 17, 18: 19, 20: 21, 22: 23}
_ENDS = {10: (0.02, -0.015, 0.07), 15: (0.0, 0.13, 0.01), 22: (0.07, -0.005, 0.01)}
"""From a left or middle joint without a child to the end of its bone."""
_BLEND_M = 0.02
"""How far from a crease two primitives flow into one."""
_SOFTNESS_M = 0.018
"""Difference of distance over which the skin changes from one bone's to another's."""
_GRID_M = 0.011
_MARGIN_M = 0.03


def rest_joints() -> Array:
    """Joints of the T-pose [24, 3]."""
    joints = np.zeros((24, 3))
    for joint, place in _LEFT_AND_MIDDLE.items():
        joints[joint] = place
        if joint in _OTHER_SIDE:
            joints[_OTHER_SIDE[joint]] = np.array(place) * [-1.0, 1.0, 1.0]
    return joints


@dataclass(frozen=True)
class Figure:
    """A surface with its bones."""

    joints: Array
    """[24, 3]"""
    vertices: Array
    """[V, 3]"""
    normals: Array
    """[V, 3], outwards."""
    faces: NDArray[np.int64]
    """[T, 3]"""
    weights: Array
    """[V, 24], rows sum to one."""


def make_figure() -> Figure:
    """The one figure of this test set."""
    joints = rest_joints()
    vertices, faces = _surface(joints)
    step = 0.002
    normals = np.stack(
        [
            _distance(vertices + step * axis, joints) - _distance(vertices - step * axis, joints)
            for axis in np.eye(3)
        ],
        axis=1,
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    corners = vertices[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum("ti,ti->t", flat, normals[faces].sum(axis=1)) < 0.0
    faces[inwards] = faces[inwards][:, ::-1]
    return Figure(joints, vertices, normals, faces, _weights(vertices, joints))


def joint_frames(joints: Array, rotations: Array, root: Array) -> tuple[Array, Array]:
    """Global rotations [24, 3, 3] and places [24, 3] of joints turned by `rotations` [24, 3, 3]
    against their parents, the pelvis at `root`."""
    turned, places = np.zeros((24, 3, 3)), np.zeros((24, 3))
    turned[0], places[0] = rotations[0], root
    for joint in range(1, 24):
        above = TREE[joint]
        turned[joint] = turned[above] @ rotations[joint]
        places[joint] = places[above] + turned[above] @ (joints[joint] - joints[above])
    return turned, places


def posed(figure: Figure, rotations: Array, root: Array) -> tuple[Array, Array]:
    """Vertices [V, 3] and unit normals [V, 3] of the figure in a pose (see `joint_frames`)."""
    turned, places = joint_frames(figure.joints, rotations, root)
    vertices, normals = np.zeros_like(figure.vertices), np.zeros_like(figure.normals)
    for joint in range(24):
        share = figure.weights[:, joint, None]
        moved = (figure.vertices - figure.joints[joint]) @ turned[joint].T + places[joint]
        vertices += share * moved
        normals += share * (figure.normals @ turned[joint].T)
    return vertices, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _ellipsoid(points: Array, centre: tuple[float, ...], radii: tuple[float, ...]) -> Array:
    scaled = (points - centre) / radii
    length = np.linalg.norm(scaled, axis=1)
    slope = np.linalg.norm(scaled / radii, axis=1)
    return length * (length - 1.0) / np.maximum(slope, 1e-9)


def _limb(points: Array, start: Array, end: Array, radii: tuple[float, float]) -> Array:
    along = end - start
    at = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    gap = np.linalg.norm(points - start - at[:, None] * along, axis=1)
    return gap - (radii[0] + at * (radii[1] - radii[0]))


def _distance(points: Array, joints: Array) -> Array:
    """About the distance to the surface, m; negative inside. The figure is as its mirror image."""
    points = points.copy()
    points[:, 0] = np.abs(points[:, 0])
    j = joints
    parts = [
        _ellipsoid(points, (0.0, -0.27, 0.0), (0.165, 0.13, 0.118)),  # hips
        _ellipsoid(points, (0.0, -0.08, 0.015), (0.148, 0.20, 0.108)),  # waist
        _ellipsoid(points, (0.0, 0.10, 0.005), (0.172, 0.20, 0.116)),  # chest
        _limb(points, j[9] + [0.06, 0.1, -0.03], j[16] + [-0.01, 0.0, 0.0], (0.07, 0.064)),
        _limb(points, j[12] - [0.0, 0.05, 0.01], j[15], (0.060, 0.054)),  # neck
        _ellipsoid(points, (0.0, 0.425, 0.036), (0.078, 0.118, 0.098)),  # head
        _ellipsoid(points, (0.0, 0.475, 0.008), (0.088, 0.092, 0.104)),  # hair
        _ellipsoid(points, (0.0, 0.405, 0.137), (0.013, 0.024, 0.022)),  # nose
        _ellipsoid(points, (0.078, 0.42, 0.03), (0.012, 0.032, 0.02)),  # ears
        _limb(points, j[16], j[18], (0.064, 0.050)),  # sleeves
        _limb(points, j[18], j[20] - [0.03, 0.0, 0.0], (0.050, 0.039)),
        _limb(points, j[20] - [0.04, 0.0, 0.0], j[20], (0.030, 0.030)),  # wrists
        _ellipsoid(points, (0.755, 0.219, -0.042), (0.062, 0.019, 0.042)),  # palms
        _ellipsoid(points, (0.825, 0.214, -0.044), (0.062, 0.014, 0.034)),  # fingers
        _limb(points, j[20] + [0.02, 0.0, 0.02], j[22] + [-0.01, 0.0, 0.06], (0.018, 0.012)),
        _limb(points, j[1] + [0.02, 0.0, 0.0], j[4], (0.104, 0.071)),  # trousers
        _limb(points, j[4], j[7] + [0.0, 0.06, 0.0], (0.071, 0.066)),
        _limb(points, j[7] + [0.0, 0.03, 0.0], j[7] - [0.0, 0.04, 0.01], (0.040, 0.046)),  # shoes
        _limb(points, j[7] - [0.0, 0.055, 0.01], j[10] + [0.006, -0.012, 0.06], (0.042, 0.036)),
    ]
    surface = parts[0]
    for part in parts[1:]:
        blend = np.maximum(_BLEND_M - np.abs(surface - part), 0.0) / _BLEND_M
        surface = np.minimum(surface, part) - 0.25 * _BLEND_M * blend**2
    return surface


def _surface(joints: Array) -> tuple[Array, NDArray[np.int64]]:
    """Vertices [V, 3] and faces [T, 3] where `_distance` is nil, by surface nets."""
    low = joints.min(axis=0) - np.array([0.12, 0.06, 0.16]) - _MARGIN_M
    high = joints.max(axis=0) + np.array([0.12, 0.22, 0.10]) + _MARGIN_M
    shape = np.ceil((high - low) / _GRID_M).astype(int) + 1
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1)
    places = low + _GRID_M * grid.reshape(-1, 3)
    blocks = np.array_split(places, 32)
    values = np.concatenate([_distance(block, joints) for block in blocks]).reshape(shape)
    cells, total, crossings = tuple(shape - 1), np.zeros((*(shape - 1), 3)), np.zeros(shape - 1)
    edges = []
    for axis in range(3):
        one = np.take(values, np.arange(shape[axis] - 1), axis)
        other = np.take(values, np.arange(1, shape[axis]), axis)
        crossed = np.argwhere((one < 0.0) != (other < 0.0))
        at = tuple(crossed.T)
        point = crossed + (one[at] / (one[at] - other[at]))[:, None] * np.eye(3)[axis]
        across = [a for a in range(3) if a != axis]
        around = []
        for back in ((0, 0), (1, 0), (1, 1), (0, 1)):  # the four cells that share the edge
            cell = crossed.copy()
            cell[:, across] -= back
            np.add.at(total, tuple(cell.T), point)
            np.add.at(crossings, tuple(cell.T), 1.0)
            around.append(np.ravel_multi_index(tuple(cell.T), cells))
        edges.append(np.stack(around, axis=1))
    quads = np.concatenate(edges)
    filled = np.flatnonzero(crossings)
    number = np.full(crossings.size, -1)
    number[filled] = np.arange(len(filled))
    middle = (total.reshape(-1, 3) / np.maximum(crossings.ravel(), 1.0)[:, None])[filled]
    quads = number[quads]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return low + _GRID_M * middle, faces


def _weights(points: Array, joints: Array) -> Array:
    """Of every joint for every point [V, 24]: the nearer its bone, the more."""
    distance = np.full((len(points), 24), np.inf)
    for joint in range(24):
        middle = {other: one for one, other in _OTHER_SIDE.items()}.get(joint, joint)
        ends = [joints[child] for child in range(24) if TREE[child] == joint]
        if not ends:
            side = -1.0 if middle != joint else 1.0
            ends = [joints[joint] + np.array(_ENDS[middle]) * [side, 1.0, 1.0]]
        for end in ends:
            gap = _limb(points, joints[joint], end, (0.0, 0.0))
            distance[:, joint] = np.minimum(distance[:, joint], gap)
    nearer = np.exp(-(distance - distance.min(axis=1, keepdims=True)) / _SOFTNESS_M)
    nearer[nearer < 0.02] = 0.0
    return nearer / nearer.sum(axis=1, keepdims=True)
