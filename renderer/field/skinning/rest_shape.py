"""What is known of a body at rest before any picture is seen: who moves which place, and where the
skin is about.

With a surface: each grid point takes the blend weights of the nearest surface sample and the signed
distance to it. Without one: Gaussian bones as thick as an adult's limbs. Both over one canonical
box, on a grid with axes z, y, x. `bone_shape` is HumanNeRF's prior (Weng et al. 2022, sec. 3.2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scene.arrays import Array, Bool, Float, Int
from scene.body import Body
from scene.skeleton import Skeleton

_BOX_MARGIN_M = 0.04
"""Empty border round the shell, so that the volume's outermost points are background."""
_PAST_JOINTS_M = 0.2
"""How far a body reaches past its outermost joints: the crown above the head's."""
_REFERENCE_HEIGHT_M = 1.58
"""Floor to head joint of the adult that the radii below are taken from."""
_RADII_M = {
    "pelvis": 0.12,
    "hip": 0.08,
    "spine1": 0.12,
    "spine2": 0.12,
    "spine3": 0.12,
    "knee": 0.06,
    "ankle": 0.045,
    "foot": 0.04,
    "neck": 0.06,
    "head": 0.11,
    "collar": 0.07,
    "shoulder": 0.055,
    "elbow": 0.045,
    "wrist": 0.04,
    "hand": 0.045,
}
_BONE_SPREAD = 0.75
"""Standard deviation of a Gaussian bone, as a share of its limb's radius."""
_OTHER_RADIUS_M = 0.05
"""The same for joints that SMPL's skeleton does not have."""
_LEAF_M = {"head": (0.0, 0.08, 0.0), "foot": (0.0, 0.0, 0.05)}
"""Where a bone without a child joint ends, from its joint, T-pose."""


@dataclass(frozen=True, eq=False)
class RestShape:
    """Prior knowledge on a grid over the canonical box."""

    low: Float[Array, "3"]
    """Low corner of the box, m; the first grid point."""
    high: Float[Array, "3"]
    prior: Float[Array, "25 D H W"]
    """Probability that joint k moves the place; the last channel is background. Sums to one."""
    signed_distance: Float[Array, "D H W"]
    """To the expected skin, m; negative inside."""


def rest_shape(body: Body, volume: tuple[int, int, int], outside_m: float) -> RestShape:
    """The prior of `body` on a grid of shape `volume`.

    The likelihood of any body is 1 up to `outside_m` above the skin and falls to 0 over one more
    cell; inside, everything is body.
    """
    low, high, points = _canonical_box(body, volume, outside_m)
    cell = float(((high - low) / (np.array(volume[::-1]) - 1)).max())
    if body.rest_vertices is None:
        bones, distance = _from_bones(body.skeleton, points)
        weights = bones / np.maximum(bones.sum(-1, keepdims=True), 1e-12)
    else:
        weights, distance = _from_surface(body, points, low, high)
    likely = np.clip((outside_m + cell - distance) / cell, 0.0, 1.0)
    prior = np.concatenate([weights * likely[..., None], 1.0 - likely[..., None]], axis=-1)
    return _shape(low, high, prior, distance)


def bone_shape(skeleton: Skeleton, volume: tuple[int, int, int], outside_m: float) -> RestShape:
    """Gaussian bones alone, whatever else is known: joint k's weight falls with the distance from
    its bones, what they leave of 1 is background, and all of it is normalised."""
    low, high, points = _canonical_box(Body(skeleton), volume, outside_m)
    bones, distance = _from_bones(skeleton, points)
    bones = bones ** (1.0 / _BONE_SPREAD**2)
    background = 1.0 - bones.sum(-1, keepdims=True).clip(max=1.0)
    prior = np.concatenate([bones, background], axis=-1)
    return _shape(low, high, prior / prior.sum(-1, keepdims=True), distance)


def _canonical_box(
    body: Body, volume: tuple[int, int, int], outside_m: float
) -> tuple[Float[Array, "3"], Float[Array, "3"], Float[Array, "D H W 3"]]:
    """Low and high corner of the box round `body` at rest, and its grid points."""
    reach = outside_m + _BOX_MARGIN_M
    places = body.rest_vertices
    if places is None:
        places = body.skeleton.rest_joints
        reach += _PAST_JOINTS_M * _scale(body.skeleton)
    low, high = places.min(axis=0) - reach, places.max(axis=0) + reach
    axes = [np.linspace(low[a], high[a], volume[2 - a]) for a in (2, 1, 0)]
    z, y, x = np.meshgrid(*axes, indexing="ij")
    return low, high, np.stack([x, y, z], axis=-1)


def _shape(low: Array, high: Array, prior: Array, distance: Array) -> RestShape:
    # stored as bytes in model files: rounded now, so that a reloaded model is the trained one
    rounded = np.round(prior * 255.0) / 255.0
    return RestShape(
        low.astype(np.float32),
        high.astype(np.float32),
        np.ascontiguousarray(np.moveaxis(rounded, -1, 0)).astype(np.float32),
        distance.astype(np.float32),
    )


def _scale(skeleton: Skeleton) -> float:
    return skeleton.height_m / _REFERENCE_HEIGHT_M


def _from_bones(skeleton: Skeleton, points: Array) -> tuple[Array, Array]:
    """Each joint's Gaussian bones [..., K] and the distance to the union of their capsules."""
    scale = _scale(skeleton)
    density, distance = [], []
    for joint, name in enumerate(skeleton.names):
        kind = name.split("_")[-1]
        start = skeleton.rest_joints[joint]
        ends = [skeleton.rest_joints[c] for c, p in enumerate(skeleton.parents) if p == joint]
        if not ends:
            sideways = (np.sign(start[0]) * 0.07, 0.0, 0.0)
            ends = [start + scale * np.array(_LEAF_M.get(kind, sideways))]
        away = np.min([_to_segment(points, start, end) for end in ends], axis=0)
        radius = _RADII_M.get(kind, _OTHER_RADIUS_M) * scale
        density.append(np.exp(-0.5 * (away / radius) ** 2))
        distance.append(away - radius)
    return np.stack(density, axis=-1), np.min(distance, axis=0)


def _to_segment(points: Array, start: Array, end: Array) -> Array:
    bone = end - start
    along = np.clip((points - start) @ bone / max(float(bone @ bone), 1e-12), 0.0, 1.0)
    return np.linalg.norm(points - start - along[..., None] * bone, axis=-1)


def _from_surface(body: Body, points: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Blend weights [..., 24] of the nearest surface sample and the signed distance to it."""
    assert body.rest_vertices is not None
    assert body.faces is not None
    assert body.blend_weights is not None
    corners = body.rest_vertices[body.faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(body.rest_vertices)
    for corner in range(3):
        np.add.at(normals, body.faces[:, corner], flat)
    samples = np.concatenate([body.rest_vertices, corners.mean(axis=1)])
    outward = np.concatenate([normals, flat])
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    weights = np.concatenate([body.blend_weights, body.blend_weights[body.faces].mean(axis=1)])
    nearest = _nearest_sample(points, samples, low, high)
    away = points - samples[nearest]
    distance = np.linalg.norm(away, axis=-1)
    # a normal tells the side only near the skin: past a fingertip the nearest may face away
    near = distance < np.linalg.norm((high - low) / (np.array(distance.shape[::-1]) - 1))
    inside = np.where(
        near, np.einsum("...x,...x->...", away, outward[nearest]) < 0.0, ~_flooded(~near)
    )
    return weights[nearest], np.where(inside, -distance, distance)


def _nearest_sample(points: Array, samples: Array, low: Array, high: Array) -> Int[Array, "D H W"]:
    """Index of the nearest sample of each grid point, by jump flooding (Rong and Tan 2006)."""
    shape = points.shape[:3]
    size = np.array(shape[::-1]) - 1
    cell = np.rint((samples - low) / (high - low) * size).astype(np.int64)
    nearest = np.full(shape, -1, np.int64)
    nearest[cell[:, 2], cell[:, 1], cell[:, 0]] = np.arange(len(samples))
    best = np.where(nearest < 0, np.inf, np.sum((points - samples[nearest]) ** 2, axis=-1))
    jump = 1 << int(np.ceil(np.log2(max(shape) / 2)))
    jumps = [1]
    while jump >= 1:
        jumps.append(jump)
        jump //= 2
    for step in [*jumps, 1]:
        for axis in range(3):
            for shift in (-step, step):
                candidate = _shifted(nearest, axis, shift)
                distance = np.sum((points - samples[candidate]) ** 2, axis=-1)
                closer = (candidate >= 0) & (distance < best)
                nearest, best = (
                    np.where(closer, candidate, nearest),
                    np.where(closer, distance, best),
                )
    return nearest


def _flooded(free: Bool[Array, "D H W"]) -> Bool[Array, "D H W"]:
    """The free cells that can be reached from the border."""
    reached = np.ones_like(free)
    reached[1:-1, 1:-1, 1:-1] = False
    reached &= free
    while True:
        grown = reached.copy()
        grown[1:] |= reached[:-1]
        grown[:-1] |= reached[1:]
        grown[:, 1:] |= reached[:, :-1]
        grown[:, :-1] |= reached[:, 1:]
        grown[..., 1:] |= reached[..., :-1]
        grown[..., :-1] |= reached[..., 1:]
        grown &= free
        if (grown == reached).all():
            return reached
        reached = grown


def _shifted(volume: Int[Array, "D H W"], axis: int, shift: int) -> Int[Array, "D H W"]:
    """`volume` moved along `axis`, with -1 where nothing came from."""
    moved = np.full_like(volume, -1)
    here: list[slice] = [slice(None)] * 3
    there: list[slice] = [slice(None)] * 3
    here[axis] = slice(shift, None) if shift > 0 else slice(None, shift)
    there[axis] = slice(None, -shift) if shift > 0 else slice(-shift, None)
    if abs(shift) < volume.shape[axis]:
        moved[tuple(here)] = volume[tuple(there)]
    return moved
