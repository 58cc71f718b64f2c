"""Estimates rest joints from posed vertices and joint angles, without the data set's body model.

A data set may hold posed vertices and joint angles, but no joints: these need SMPL, whose licence
forbids copies. Every vertex that moves rigidly with one bone constrains that bone's transform. With
W_fk the rotation of bone k at frame f (known from the angles) and J the rest joints, the joint is
at p_fk(J), linear in J, and a vertex v of bone k at x_fv = p_fk(J) + W_fk y_v: least squares in J,
y_v eliminated as a mean over frames. The bone of each vertex and J are estimated in alternation.
"""

from __future__ import annotations

import numpy as np

from capture.body.model import load_body_model
from scene.arrays import Array, Float
from scene.motion import Pose
from scene.rotations import axis_angle_to_matrix
from scene.skeleton import JOINT_COUNT, PARENTS

_ITERATIONS = 12
_RIGID_M = 0.01
"""Residual at which a vertex counts half; near joints none moves rigidly with one bone."""
_PRIOR = 1e-3
"""Weight of the mean body's bones beside the vertices: they decide only what no motion
determines."""


def joints_from_vertices(
    vertices: Float[Array, "F V 3"], joint_angles: Float[Array, "F 24 3"]
) -> Float[Array, "24 3"]:
    """Rest joints, m, in the frame of `vertices`, whose pelvis is at its rest place.

    More varied poses determine more; what none determines is as on the mean body.
    """
    rotations = axis_angle_to_matrix(joint_angles)
    global_rotations = rotations.copy()
    for joint, parent in enumerate(PARENTS[1:], start=1):
        global_rotations[:, joint] = global_rotations[:, parent] @ rotations[:, joint]
    chain = _chain(global_rotations)  # [F 24 24 3 3]: p_fk = sum_j chain_fkj J_j
    prior = joints = _mean_joints(vertices, joint_angles)
    in_bone = np.einsum("fkyx,fvy->fkvx", global_rotations, vertices)  # W^T x
    design = np.einsum("fkyx,fkjyz->fkxjz", global_rotations, chain).reshape(
        *global_rotations.shape[:3], -1
    )
    design -= design.mean(axis=0)  # what is constant over all frames carries no information
    in_bone -= in_bone.mean(axis=0)
    gram = np.einsum("fkxi,fkxj->kij", design, design)
    bones = np.eye(JOINT_COUNT)
    bones[np.arange(1, JOINT_COUNT), PARENTS[1:]] = -1.0
    bones = np.kron(bones, np.eye(3))  # J -> each joint relative to its parent
    for _ in range(_ITERATIONS):
        residual = in_bone - np.einsum("fkxi,i->fkx", design, joints.ravel())[:, :, None]
        distance = (residual**2).sum(axis=-1).mean(axis=0)  # [24 V]
        bone = distance.argmin(axis=0)
        robust_weight = 1.0 / (1.0 + distance.min(axis=0) / _RIGID_M**2)
        weight = np.zeros_like(distance)
        weight[bone, np.arange(len(bone))] = robust_weight
        weighted_sum = np.einsum("kv,fkvx->fkx", weight, in_bone)
        normal = np.einsum("k,kij->ij", weight.sum(axis=1), gram)
        right = np.einsum("fkxi,fkx->i", design, weighted_sum)
        ridge = _PRIOR * len(vertices) * weight.sum() / JOINT_COUNT
        joints = np.linalg.solve(
            normal + ridge * bones.T @ bones, right + ridge * bones.T @ bones @ prior.ravel()
        ).reshape(JOINT_COUNT, 3)
    return joints


def _chain(global_rotations: Float[Array, "F 24 3 3"]) -> Float[Array, "F 24 24 3 3"]:
    chain = np.zeros((len(global_rotations), JOINT_COUNT, JOINT_COUNT, 3, 3))
    chain[:, 0, 0] = np.eye(3)
    for joint, parent in enumerate(PARENTS[1:], start=1):
        chain[:, joint] = chain[:, parent]
        chain[:, joint, joint] += global_rotations[:, parent]
        chain[:, joint, parent] -= global_rotations[:, parent]
    return chain


def _mean_joints(
    vertices: Float[Array, "F V 3"], joint_angles: Float[Array, "F 24 3"]
) -> Float[Array, "24 3"]:
    """The mean body's joints, as large as `vertices` and where they are."""
    model = load_body_model()
    body = model.body(np.zeros(model.shape_count))
    posed = np.stack([body.posed_vertices(Pose(angles, np.zeros(3))) for angles in joint_angles])
    scale = float(np.sqrt(vertices.var(axis=1).sum() / posed.var(axis=1).sum()))
    shift = vertices.mean(axis=(0, 1)) - scale * posed.mean(axis=(0, 1))
    return scale * body.skeleton.rest_joints + shift
