"""Forward kinematics, linear blend skinning and projection of torch tensors, batched over frames.

Everything is in OpenGL's camera frame: y up, z towards the viewer, the camera at the origin, so
that a person who faces the camera faces +z as at rest. F frames, 24 joints, V sampled vertices.
The tensors are small, and a fit takes hundreds of steps: as operations of torch these would be most
of its time, so they are compiled, with their gradients (`kinematics_kernels`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from torch.autograd import Function

from capture.fitting import kinematics_kernels as kernels
from scene.arrays import Array, Float, Int, Tensor
from scene.skeleton import PARENTS

_PARENTS = np.array(PARENTS)


class PosedBody(NamedTuple):
    """A skeleton posed in every frame, and the shape it belongs to."""

    global_rotations: Float[Tensor, "F 24 3 3"]
    joint_positions: Float[Tensor, "F 24 3"]
    """m."""
    rest_joints: Float[Tensor, "24 3"]
    shape: Float[Tensor, "B"]


class BlendWeights(NamedTuple):
    """The few joints that move each vertex, those of most weight first."""

    joints: Int[Array, "V K"]
    weights: Float[Array, "V K"]
    """0 where fewer joints do."""

    @classmethod
    def of(cls, dense: Float[Array, "V 24"]) -> BlendWeights:
        """Those above nought of `dense`."""
        most = int((dense > 0.0).sum(axis=1).max())
        joints = np.argsort(-dense, axis=1, kind="stable")[:, :most].copy()
        return cls(joints, np.take_along_axis(dense, joints, axis=1).astype(np.float32))

    @classmethod
    def rigid(cls, joints: Int[Array, "V"]) -> BlendWeights:
        """One joint moves each vertex."""
        return cls(joints[:, None], np.ones((len(joints), 1), np.float32))


def rotation_matrices(axis_angle: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Rodrigues' formula, differentiable at zero too."""
    return _Rotations.apply(axis_angle.reshape(-1, 3)).reshape(*axis_angle.shape, 3)


def forward_kinematics(
    rotations: Float[Tensor, "F 24 3 3"], root: Float[Tensor, "F 3"], rest: Float[Tensor, "24 3"]
) -> tuple[Float[Tensor, "F 24 3 3"], Float[Tensor, "F 24 3"]]:
    """Global rotations and positions of all joints; `root` is the position of joint 0 itself."""
    return _Chain.apply(rotations, root, rest)


def skinned_points(
    posed: PosedBody,
    points: Float[Tensor, "V 3"],
    blend_weights: BlendWeights,
    which: Int[Array, "F P"] | None = None,
) -> Float[Tensor, "F P 3"]:
    """Rest `points` by linear blend skinning: all of them, or those that each frame asks for."""
    if which is None:
        which = np.tile(np.arange(len(points)), (len(posed.global_rotations), 1))
    joints = posed.global_rotations, posed.joint_positions, posed.rest_joints
    return _Skin.apply(*joints, points, blend_weights, which)


def project(
    points: Float[Tensor, "*batch 3"], focal_px: Tensor, centre: Float[Tensor, "2"]
) -> Float[Tensor, "*batch 2"]:
    """Pixels of points; points at the camera are kept finite."""
    x, y = centre.tolist()
    pixels = _Pinhole.apply(points.reshape(-1, 3), focal_px, x, y)
    return pixels.reshape(*points.shape[:-1], 2)


def array_of(value: Tensor) -> Array:
    """What kernels take: without gradients, in one piece."""
    return value.detach().contiguous().numpy()


class _Rotations(Function):
    @staticmethod
    def forward(ctx: Any, angles: Tensor) -> Tensor:
        ctx.save_for_backward(angles)
        rotations = angles.new_empty(len(angles), 3, 3)
        kernels.rotate(array_of(angles), rotations.numpy())
        return rotations

    @staticmethod
    def backward(ctx: Any, by_rotation: Tensor) -> Tensor:
        (angles,) = ctx.saved_tensors
        by_angle = angles.new_empty(angles.shape)
        kernels.rotate_back(array_of(angles), array_of(by_rotation), by_angle.numpy())
        return by_angle


class _Chain(Function):
    @staticmethod
    def forward(ctx: Any, local: Tensor, root: Tensor, rest: Tensor) -> tuple[Tensor, Tensor]:
        rotations, positions = local.new_empty(local.shape), local.new_empty(local.shape[:3])
        given = array_of(local), array_of(root), array_of(rest)
        kernels.chain(*given, _PARENTS, rotations.numpy(), positions.numpy())
        ctx.save_for_backward(local, rest, rotations)
        return rotations, positions

    @staticmethod
    def backward(
        ctx: Any, by_rotation: Tensor, by_position: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        local, rest, rotations = ctx.saved_tensors
        shapes = local.shape, (len(local), 3), rest.shape
        found = tuple(local.new_zeros(shape) for shape in shapes)
        kernels.chain_back(
            array_of(local),
            array_of(rest),
            _PARENTS,
            array_of(rotations),
            array_of(by_rotation).copy(),
            array_of(by_position).copy(),
            *(value.numpy() for value in found),
        )
        return found


class _Skin(Function):
    @staticmethod
    def forward(
        ctx: Any,
        rotations: Tensor,
        positions: Tensor,
        rest: Tensor,
        points: Tensor,
        blend_weights: BlendWeights,
        which: Array,
    ) -> Tensor:
        posed = points.new_empty(*which.shape, 3)
        kernels.skin(
            array_of(rotations),
            array_of(positions),
            array_of(rest),
            array_of(points),
            *blend_weights,
            which,
            posed.numpy(),
        )
        ctx.save_for_backward(rotations, positions, rest, points)
        ctx.moved_by, ctx.which = blend_weights, which
        return posed

    @staticmethod
    def backward(ctx: Any, by_posed: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, None, None]:
        rotations, positions, rest, points = ctx.saved_tensors
        moved_by: BlendWeights = ctx.moved_by
        shapes = rotations.shape, positions.shape, rest.shape, points.shape
        found = tuple(points.new_zeros(shape) for shape in shapes)
        kernels.skin_back(
            array_of(rotations),
            array_of(rest),
            array_of(points),
            *moved_by,
            ctx.which,
            array_of(by_posed),
            *(value.numpy() for value in found),
        )
        return found[0], found[1], found[2], found[3], None, None


class _Pinhole(Function):
    @staticmethod
    def forward(ctx: Any, points: Tensor, focal_px: Tensor, x: float, y: float) -> Tensor:
        ctx.save_for_backward(points, focal_px)
        pixels = points.new_empty(len(points), 2)
        kernels.pinhole(array_of(points), float(focal_px), x, y, pixels.numpy())
        return pixels

    @staticmethod
    def backward(ctx: Any, by_pixel: Tensor) -> tuple[Tensor, Tensor, None, None]:
        points, focal_px = ctx.saved_tensors
        by_point = points.new_empty(points.shape)
        by_focal = kernels.pinhole_back(
            array_of(points), float(focal_px), array_of(by_pixel), by_point.numpy()
        )
        return by_point, focal_px.new_tensor(by_focal), None, None
