"""Where the joints of a body are, from how its vertices move: no body model is needed.

A data set may hold posed vertices and joint angles, but no joints: these need SMPL, which nobody
may pass on. Yet every vertex that keeps to one bone says where the bone went. With W_fk the
rotation of bone k at frame f (known from the angles) and J the rest joints, the joint stands at
p_fk(J), linear in J, and a vertex v of bone k at x_fv = p_fk(J) + W_fk y_v: least squares in J,
y_v eliminated as a mean over frames. Which bone a vertex keeps to is found in turns with J.
"""

from __future__ import annotations

import numpy as np

from capture.body.model import load_body_model
from scene.arrays import Array, Float
from scene.motion import Pose
from scene.rotations import axis_angle_to_matrix
from scene.skeleton import JOINT_COUNT, PARENTS

_ROUNDS = 12
_RIGID_M = 0.01
"""A vertex that strays so far from its bone counts half; near joints none keeps to one."""
_PRIOR = 1e-3
"""Weight of the mean body's bones beside the vertices: they decide only what no motion tells."""


def joints_from_vertices(
    vertices: Float[Array, "F V 3"], joint_angles: Float[Array, "F 24 3"]
) -> Float[Array, "24 3"]:
    """Rest joints, m, in the frame of `vertices`, whose pelvis is at its rest place.

    More frames of more varied poses tell more; what none tells is as on the mean body.
    """
    rotations = axis_angle_to_matrix(joint_angles)
    turned = rotations.copy()
    for joint, parent in enumerate(PARENTS[1:], start=1):
        turned[:, joint] = turned[:, parent] @ rotations[:, joint]
    chain = _chain(turned)  # [F 24 24 3 3]: p_fk = sum_j chain_fkj J_j
    prior = joints = _mean_joints(vertices, joint_angles)
    in_bone = np.einsum("fkyx,fvy->fkvx", turned, vertices)  # W^T x
    design = np.einsum("fkyx,fkjyz->fkxjz", turned, chain).reshape(*turned.shape[:3], -1)
    design -= design.mean(axis=0)  # what is the same in all frames tells nothing
    in_bone -= in_bone.mean(axis=0)
    gram = np.einsum("fkxi,fkxj->kij", design, design)
    bones = np.eye(JOINT_COUNT)
    bones[np.arange(1, JOINT_COUNT), PARENTS[1:]] = -1.0
    bones = np.kron(bones, np.eye(3))  # J -> each joint as seen from its parent
    for _ in range(_ROUNDS):
        off = in_bone - np.einsum("fkxi,i->fkx", design, joints.ravel())[:, :, None]
        stray = (off**2).sum(axis=-1).mean(axis=0)  # [24 V]
        bone = stray.argmin(axis=0)
        trust = 1.0 / (1.0 + stray.min(axis=0) / _RIGID_M**2)
        weight = np.zeros_like(stray)
        weight[bone, np.arange(len(bone))] = trust
        pulled = np.einsum("kv,fkvx->fkx", weight, in_bone)
        left = np.einsum("k,kij->ij", weight.sum(axis=1), gram)
        right = np.einsum("fkxi,fkx->i", design, pulled)
        ridge = _PRIOR * len(vertices) * weight.sum() / JOINT_COUNT
        joints = np.linalg.solve(
            left + ridge * bones.T @ bones, right + ridge * bones.T @ bones @ prior.ravel()
        ).reshape(JOINT_COUNT, 3)
    return joints


def _chain(turned: Float[Array, "F 24 3 3"]) -> Float[Array, "F 24 24 3 3"]:
    chain = np.zeros((len(turned), JOINT_COUNT, JOINT_COUNT, 3, 3))
    chain[:, 0, 0] = np.eye(3)
    for joint, parent in enumerate(PARENTS[1:], start=1):
        chain[:, joint] = chain[:, parent]
        chain[:, joint, joint] += turned[:, parent]
        chain[:, joint, parent] -= turned[:, parent]
    return chain


def _mean_joints(
    vertices: Float[Array, "F V 3"], joint_angles: Float[Array, "F 24 3"]
) -> Float[Array, "24 3"]:
    """The mean body's joints, as large as `vertices` and where they are."""
    model = load_body_model()
    body = model.body(np.zeros(model.shape_count))
    ours = np.stack([body.posed_vertices(Pose(angles, np.zeros(3))) for angles in joint_angles])
    scale = float(np.sqrt(vertices.var(axis=1).sum() / ours.var(axis=1).sum()))
    shift = vertices.mean(axis=(0, 1)) - scale * ours.mean(axis=(0, 1))
    return scale * body.skeleton.rest_joints + shift
