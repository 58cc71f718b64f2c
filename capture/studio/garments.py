"""Loose clothes: a skirt and wide sleeves that lag behind the body and hang from it.

A garment is a tube of rings; its first ring is fixed to a joint, and each thread (one vertex of
every ring) hangs from there at a fixed length. Threads follow the joint by a weak spring, fall by
their inertia and gravity, and are pushed out of the limbs inside: position-based dynamics (Müller
et al. 2007) at a fixed step, so the same motion gives the same cloth. It has no effect on the body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scene.arrays import Array, Float, Int
from scene.body import Body
from scene.motion import Motion
from scene.skeleton import JOINT_NAMES

_STEPS_PER_SECOND = 60.0
_SETTLING_S = 4.0
"""How long clothes settle in the first pose before the motion begins."""
_SPRING_HZ = 0.8
"""Frequency at which a thread swings about its rest position."""
_DRAG_HZ = 1.0
"""Share of its speed that a thread loses in a second."""
_GRAVITY = np.array([0.0, -9.81, 0.0])
_SMOOTHING = 0.1
"""Share of its neighbours' mean that a thread's offset takes on each step: cloth is coherent."""
_CLEARANCE_M = 0.012
"""Distance kept between cloth and skin."""
_CONSTRAINT_ITERATIONS = 8
"""Projections of lengths and collisions a step; more only stiffen the cloth."""
_SIDES = 32


@dataclass(frozen=True, eq=False)
class Garment:
    """A tube of R rings of A vertices, fixed to a joint by its first ring."""

    joint: int
    rest: Float[Array, "R A 3"]
    """T-pose, m; the last vertex of a ring is its first again, for the texture's seam."""
    limbs: tuple[tuple[int, int, float], ...]
    """Colliders: capsules between two joints, with their radius, m."""
    texture: Float[Array, "R A 2"]
    """Metres around and metres down to the hem (0 at the hem)."""

    @property
    def faces(self) -> Int[Array, "T 3"]:
        """Triangles over the vertices, ring by ring."""
        rings, sides = self.rest.shape[:2]
        corner = (np.arange(rings - 1)[:, None] * sides + np.arange(sides - 1)).ravel()
        upper = np.stack([corner, corner + sides, corner + 1], axis=1)
        lower = np.stack([corner + 1, corner + sides, corner + sides + 1], axis=1)
        return np.concatenate([upper, lower])


@dataclass(frozen=True, eq=False)
class Drape:
    """Simulated garments over a motion."""

    times_s: Float[Array, "S"]
    vertices: Float[Array, "S V 3"]
    """World positions of all garments' vertices, in their order."""

    def at(self, time_s: float) -> Float[Array, "V 3"]:
        """Positions interpolated between the two nearest steps; the first or last outside."""
        position = float(np.interp(time_s, self.times_s, np.arange(len(self.times_s))))
        before = min(int(position), len(self.times_s) - 2)
        fraction = position - before
        return (1.0 - fraction) * self.vertices[before] + fraction * self.vertices[before + 1]


def make_garments(body: Body) -> tuple[Garment, ...]:
    """A skirt to above the knee, and sleeves that open from the elbow on."""
    return _skirt(body), *(_sleeve(body, side) for side in ("left", "right"))


def drape(garments: tuple[Garment, ...], body: Body, motion: Motion) -> Drape:
    """Simulate `garments` on `body` during `motion`."""
    count = max(2, int(np.ceil(motion.duration_s * _STEPS_PER_SECOND)) + 1)
    times = motion.times_s[0] + np.arange(count) / _STEPS_PER_SECOND
    moving = Motion.from_poses([motion.pose_at(float(time)) for time in times])
    angles, root = moving.joint_angles, moving.root_translation
    skinning = body.skeleton.skinning_transforms(angles, root)
    joints = body.skeleton.joint_transforms(angles, root)[..., :3, 3]
    simulated = [_simulate(garment, skinning[:, garment.joint], joints) for garment in garments]
    return Drape(times, np.concatenate([h.reshape(count, -1, 3) for h in simulated], axis=1))


def _simulate(
    garment: Garment, skinning: Float[Array, "S 4 4"], joints: Float[Array, "S 24 3"]
) -> Float[Array, "S R A 3"]:
    step = 1.0 / _STEPS_PER_SECOND
    lengths = np.linalg.norm(np.diff(garment.rest, axis=0), axis=-1, keepdims=True)
    positions = np.empty((len(skinning), *garment.rest.shape))
    current = previous = garment.rest @ skinning[0, :3, :3].T + skinning[0, :3, 3]
    settling = round(_SETTLING_S * _STEPS_PER_SECOND)
    for s in range(-settling, len(skinning)):
        frame = max(s, 0)
        target = garment.rest @ skinning[frame, :3, :3].T + skinning[frame, :3, 3]
        acceleration = (2.0 * np.pi * _SPRING_HZ) ** 2 * (target - current) + _GRAVITY
        predicted = (
            current + (1.0 - _DRAG_HZ * step) * (current - previous) + step**2 * acceleration
        )
        predicted = target + _smoothed(predicted - target)
        predicted[0] = target[0]
        for _ in range(_CONSTRAINT_ITERATIONS):
            _restore_lengths(predicted, lengths)
            for start, end, radius in garment.limbs:
                predicted[1:] = _push_out_of_capsule(
                    predicted[1:], joints[frame, start], joints[frame, end], radius
                )
        previous, current = current, predicted
        positions[frame] = current
    return positions


def _restore_lengths(threads: Float[Array, "R A 3"], lengths: Float[Array, "R-1 A 1"]) -> None:
    """Move the ends of every other link, then of the rest, half each; the fixed ring stays."""
    for first in (0, 1):
        upper, lower = threads[first:-1:2], threads[first + 1 :: 2]
        link = lower - upper
        length = np.maximum(np.linalg.norm(link, axis=-1, keepdims=True), 1e-9)
        excess = link * (1.0 - lengths[first::2] / length)
        upper_share = np.full((len(upper), 1, 1), 0.5)
        if first == 0:
            upper_share[0] = 0.0
        upper += upper_share * excess
        lower -= (1.0 - upper_share) * excess


def _smoothed(offset: Float[Array, "R A 3"]) -> Float[Array, "R A 3"]:
    ring = offset[:, :-1]
    neighbours = 0.5 * (np.roll(ring, 1, axis=1) + np.roll(ring, -1, axis=1))
    ring = (1.0 - _SMOOTHING) * ring + _SMOOTHING * neighbours
    return np.concatenate([ring, ring[:, :1]], axis=1)


def _push_out_of_capsule(
    points: Float[Array, "R A 3"], start: Float[Array, "3"], end: Float[Array, "3"], radius: float
) -> Float[Array, "R A 3"]:
    """`points`, those inside the capsule of `radius` from `start` to `end` moved to its surface."""
    bone = end - start
    along = np.clip((points - start) @ bone / (bone @ bone), 0.0, 1.0)
    nearest = start + along[..., None] * bone
    away = points - nearest
    distance = np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-6)
    return nearest + away * np.maximum(radius / distance, 1.0)


def _skirt(body: Body) -> Garment:
    at = dict(zip(JOINT_NAMES, body.skeleton.rest_joints, strict=True))
    top, hem = at["pelvis"][1] + 0.07, at["left_knee"][1] + 0.08
    heights = np.linspace(top, hem, 12)
    vertices = body.rest_vertices
    assert vertices is not None
    angles = np.linspace(0.0, 2.0 * np.pi, _SIDES + 1)
    outward = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    radii, widest = [], np.zeros(len(angles))
    for height in heights:
        slice_ = vertices[np.abs(vertices[:, 1] - height) < 0.025][:, [0, 2]]
        # cloth around a body has the width of its convex hull: the support in each direction
        widest = np.maximum(widest, (slice_ @ outward.T).max(axis=0))
        radii.append(widest + _CLEARANCE_M + 0.22 * (top - height))
    rest = np.empty((len(heights), len(angles), 3))
    rest[..., [0, 2]] = np.array(radii)[..., None] * outward
    rest[..., 1] = heights[:, None]
    hips = JOINT_NAMES.index("left_hip"), JOINT_NAMES.index("right_hip")
    thighs = tuple(
        (
            JOINT_NAMES.index(f"{side}_hip"),
            JOINT_NAMES.index(f"{side}_knee"),
            _limb_radius(body, f"{side}_hip"),
        )
        for side in ("left", "right")
    )
    return Garment(0, rest, (*thighs, (*hips, thighs[0][2])), _texture_coordinates(rest))


def _sleeve(body: Body, side: str) -> Garment:
    elbow, wrist = JOINT_NAMES.index(f"{side}_elbow"), JOINT_NAMES.index(f"{side}_wrist")
    start, end = body.skeleton.rest_joints[[elbow, wrist]]
    radius = _limb_radius(body, f"{side}_elbow")
    angles = np.linspace(0.0, 2.0 * np.pi, _SIDES // 2 + 1)
    along = np.linspace(-0.12, 0.8, 8)
    radii = radius + 0.075 * np.clip(along, 0.0, 1.0) ** 1.5
    axis = (end - start) / np.linalg.norm(end - start)
    up = np.cross(axis, [0.0, 0.0, 1.0])
    up /= np.linalg.norm(up)
    circle = np.cos(angles)[:, None] * up + np.sin(angles)[:, None] * np.cross(axis, up)
    rest = start + along[:, None, None] * (end - start) + radii[:, None, None] * circle
    return Garment(elbow, rest, ((elbow, wrist, radius),), _texture_coordinates(rest))


def _limb_radius(body: Body, joint: str) -> float:
    """Radius, m, of the capsule around the bone below `joint`: nearly the widest, and clearance."""
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    index = JOINT_NAMES.index(joint)
    start = body.skeleton.rest_joints[index]
    bone = body.skeleton.rest_joints[body.skeleton.parents.index(index)] - start
    skin = body.rest_vertices[body.blend_weights[:, index] > 0.6] - start
    along = np.clip(skin @ bone / (bone @ bone), 0.0, 1.0)
    return (
        float(np.percentile(np.linalg.norm(skin - along[:, None] * bone, axis=1), 97))
        + _CLEARANCE_M
    )


def _texture_coordinates(rest: Float[Array, "R A 3"]) -> Float[Array, "R A 2"]:
    around = np.linalg.norm(np.diff(rest[-1], axis=0), axis=1)
    down = np.linalg.norm(np.diff(rest, axis=0), axis=-1).mean(axis=1)
    texture = np.empty((*rest.shape[:2], 2))
    texture[..., 0] = np.concatenate([[0.0], np.cumsum(around)])
    texture[..., 1] = np.concatenate([np.cumsum(down[::-1])[::-1], [0.0]])[:, None]
    return texture
