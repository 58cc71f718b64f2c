"""First splats: spread over the rest surface or, where none is known, over capsules round bones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, PARAMETERS, POSITION, ROTATION
from renderer.splats.model import SplatModel
from renderer.splats.nearest import nearest_points
from renderer.splats.settings import SplatSettings
from scene.arrays import Array, Float
from scene.body import Body
from scene.errors import InvalidInput
from scene.rotations import rotation_between
from scene.sequence import Sequence
from scene.skeleton import JOINT_NAMES, Skeleton

_CAPSULE_RADIUS_M = {"spine": 0.13, "pelvis": 0.14, "hip": 0.1, "knee": 0.08, "ankle": 0.06,
                     "foot": 0.05, "neck": 0.07, "head": 0.11, "collar": 0.1, "shoulder": 0.08,
                     "elbow": 0.06, "wrist": 0.05, "hand": 0.05}  # fmt: skip
_CANDIDATES = 3
"""Points drawn on the capsules for every one kept after the masks have cut."""
_MASK_VOTES = 0.9
"""Share of the frames whose mask must cover a capsule's point."""


@dataclass(frozen=True, eq=False)
class FirstSplats:
    """Splats at rest, before training."""

    parameters: Float[Array, "N P"]
    joints: Array
    """[N 4] uint16."""
    weights: Float[Array, "N 4"]
    normals: Float[Array, "N 3"]
    """Outward, unit length."""


def first_splats(
    sequence: Sequence, settings: SplatSettings, rng: np.random.Generator
) -> FirstSplats:
    """`settings.count` splats at rest.

    Raises InvalidInput where capsules and masks have nothing in common.
    """
    body = sequence.body
    if body.has_surface:
        points, normals, weights, area = sample_surface(body, settings.count, rng)
    else:
        points, normals, weights, area = _sample_capsules(sequence, settings.count, rng)
    strongest = np.argsort(-weights, axis=1)[:, :4]
    top = np.take_along_axis(weights, strongest, axis=1)
    top /= top.sum(axis=1, keepdims=True)
    parameters = np.zeros((len(points), PARAMETERS), np.float32)
    parameters[:, POSITION : POSITION + 3] = points - settings.inset_m * normals
    spacing = np.sqrt(area / len(points))
    share = settings.scale_share if sequence.exact_poses else settings.uncertain_scale_share
    parameters[:, LOG_SCALE : LOG_SCALE + 3] = np.log(share * spacing)
    parameters[:, LOG_SCALE + 2] += np.log(settings.thickness)
    parameters[:, ROTATION : ROTATION + 4] = _from_z_axis(normals)
    parameters[:, COLOUR : COLOUR + 3] = 0.5
    parameters[:, OPACITY] = settings.opacity_logit
    return FirstSplats(
        parameters, strongest.astype(np.uint16), top.astype(np.float32), normals.astype(np.float32)
    )


def splats_of_model(model: SplatModel, first: FirstSplats, skeleton: Skeleton) -> FirstSplats:
    """The splats of an earlier `model` on `skeleton`; their normals are those of `first`."""
    joints = model.joints.astype(np.uint16)
    parameters = moved_with_bones(model.parameters, joints, model.weights, model.skeleton, skeleton)
    place = slice(POSITION, POSITION + 3)
    _, nearest = nearest_points(parameters[:, place], first.parameters[:, place])
    return FirstSplats(parameters, joints, model.weights, first.normals[nearest])


def moved_with_bones(
    parameters: Float[Array, "N P"], joints: Array, weights: Float[Array, "N 4"],
    before: Skeleton, after: Skeleton,
) -> Float[Array, "N P"]:  # fmt: skip
    """`parameters` of splats on the skeleton `before`, on the one of other bone lengths `after`."""
    moved, longer = parameters.copy(), after.rest_joints - before.rest_joints
    shift = np.einsum("ns,nsx->nx", weights, longer[joints])
    moved[:, POSITION : POSITION + 3] += shift.astype(np.float32)
    return moved


def _from_z_axis(directions: Float[Array, "N 3"]) -> Float[Array, "N 4"]:
    """Quaternions (w, x, y, z) that turn +z to unit `directions`, the shortest way."""
    x, y, z = directions.T
    turns = np.stack([1.0 + z, -y, x, np.zeros_like(z)], axis=1)
    turns[turns[:, 0] < 1e-6] = [0.0, 1.0, 0.0, 0.0]
    return turns / np.linalg.norm(turns, axis=1, keepdims=True)


def sample_surface(
    body: Body, count: int, rng: np.random.Generator
) -> tuple[Float[Array, "N 3"], Float[Array, "N 3"], Float[Array, "N K"], float]:
    """Points spread evenly by area over the rest surface, normals, blend weights, area (m^2)."""
    if body.rest_vertices is None or body.faces is None or body.blend_weights is None:
        raise InvalidInput("body must have a surface to be sampled; got joints only")
    corners = body.rest_vertices[body.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(normal, axis=1)
    # stratified along the faces' running area: more even than independent draws
    at = (np.arange(count) + rng.uniform(size=count)) / count * areas.sum()
    face = np.minimum(np.searchsorted(np.cumsum(areas), at), len(areas) - 1)
    root = np.sqrt(rng.uniform(size=count))
    v = rng.uniform(size=count)
    mix = np.stack([1.0 - root, root * (1.0 - v), root * v], axis=1)
    points = np.einsum("nc,ncx->nx", mix, corners[face])
    weights = np.einsum("nc,nck->nk", mix, body.blend_weights[body.faces[face]])
    unit = normal[face] / np.maximum(2.0 * areas[face, None], 1e-12)
    return points, unit, weights, float(areas.sum())


def _sample_capsules(
    sequence: Sequence, count: int, rng: np.random.Generator
) -> tuple[Float[Array, "N 3"], Float[Array, "N 3"], Float[Array, "N K"], float]:
    skeleton = sequence.body.skeleton
    points, normals, joints, area = _capsule_points(skeleton, _CANDIDATES * count, rng)
    weights = np.zeros((len(points), len(JOINT_NAMES)))
    # a point follows its bone, and shares the next one near the joint between them
    weights[np.arange(len(points)), joints] = 1.0
    votes, frames = np.zeros(len(points)), range(0, len(sequence.train), 4)
    for index in frames:
        votes += _inside_mask(sequence, index, points, joints)
    kept = np.flatnonzero(votes >= _MASK_VOTES * len(frames))
    if len(kept) < 100:
        raise InvalidInput(
            f"masks must cover the skeleton; got {len(kept)} of {len(points)} points of the "
            "limbs inside them; check the camera and the poses"
        )
    picked = rng.choice(kept, count, replace=len(kept) < count)
    return points[picked], normals[picked], weights[picked], area


def _capsule_points(
    skeleton: Skeleton, count: int, rng: np.random.Generator
) -> tuple[Float[Array, "N 3"], Float[Array, "N 3"], Array, float]:
    """Points on the capsules, normals, the joint that moves each, and the capsules' area."""
    rest, bones = skeleton.rest_joints, []
    for child, parent in enumerate(skeleton.parents):
        name = skeleton.names[child].split("_")[-1].rstrip("123")
        end = rest[child] + ([0.0, 0.14, 0.0] if name == "head" else 0.0)
        if parent >= 0:
            mover = child if name == "head" else parent
            bones.append((rest[parent], end, mover, _CAPSULE_RADIUS_M[name]))
    areas = np.array([2 * np.pi * r * (np.linalg.norm(b - a) + r) for a, b, _, r in bones])
    shares = rng.multinomial(count, areas / areas.sum())
    points, normals, joints = [], [], []
    for (start, end, mover, radius), share in zip(bones, shares, strict=True):
        turn = rotation_between(np.array([0.0, 1.0, 0.0]), end - start + 1e-9)
        angle = rng.uniform(0.0, 2.0 * np.pi, share)
        ring = radius * np.stack([np.cos(angle), np.zeros(share), np.sin(angle)], axis=1)
        along = rng.uniform(size=(share, 1))
        points.append(start + along * (end - start) + ring @ turn.T)
        normals.append(ring @ turn.T / radius)
        joints.append(np.full(share, mover))
    total = float(areas.sum())
    return np.concatenate(points), np.concatenate(normals), np.concatenate(joints), total


def _inside_mask(sequence: Sequence, index: int, points: Array, joints: Array) -> Array:
    camera, pose, mask = (
        sequence.train.camera(index), sequence.train.pose(index), sequence.train.mask(index)
    )  # fmt: skip
    moved = sequence.body.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    posed = np.einsum("nij,nj->ni", moved[joints][:, :3, :3], points) + moved[joints][:, :3, 3]
    pixels, _ = camera.project(posed)
    column = np.clip(pixels[:, 0].astype(int), 0, camera.width - 1)
    row = np.clip(pixels[:, 1].astype(int), 0, camera.height - 1)
    return mask[row, column] > 0.5
