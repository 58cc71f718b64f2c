"""From a posed body back to the canonical one: kinematics and inverse linear blend skinning, torch.

Letters: M_i takes rest to world for joint i; x_i = M_i^-1 x; w_i the weight volume's channel i.
HumanNeRF (Weng et al. 2022, eq. 3-4): x_skel = sum_i w_i(x_i) x_i / max(sum_i w_i(x_i), 1e-4), and
the foreground likelihood f = sum_i w_i(x_i), here clamped to 1 where parts of the body meet.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from renderer.field.networks.grid_interpolation import corners, to_grid, trilinear, weighted_rows
from scene.arrays import Float, Int, Tensor

_SMALL_ANGLE = 1e-4
_LEAST_WEIGHT = 1e-4


@dataclass(frozen=True, eq=False)
class WeightVolume:
    """The weight volume as rows: one look-up gives all joints' weights at a place."""

    rows: Float[Tensor, "V C"]
    channels: Float[Tensor, "C V"]
    """The same, one joint after the other."""
    shape: tuple[int, int, int]
    low: Float[Tensor, "3"]
    high: Float[Tensor, "3"]

    @classmethod
    def of(
        cls, volume: Float[Tensor, "C D H W"], low: Float[Tensor, "3"], high: Float[Tensor, "3"]
    ) -> WeightVolume:
        """Rows of a volume with its channels first."""
        depth, height, width = volume.shape[1:]
        channels = volume.reshape(len(volume), -1)
        return cls(channels.T.contiguous(), channels, (depth, height, width), low, high)

    def at(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N K"]:
        """Weights of the joints at canonical points; nil outside the box."""
        inside = ((points >= self.low) & (points <= self.high)).all(dim=1, keepdim=True)
        rows = trilinear(self.rows, to_grid(points, self.low, self.high, self.shape), self.shape)
        return rows[:, :-1] * inside

    def of_each_joint(self, points: Float[Tensor, "N K 3"]) -> Float[Tensor, "N K"]:
        """Weight of joint k at the k-th canonical point of each row; nil outside the box."""
        inside = ((points >= self.low) & (points <= self.high)).all(dim=2)
        at = to_grid(points.reshape(-1, 3), self.low, self.high, self.shape)
        index, weights = corners(at, self.shape)
        joints = torch.arange(points.shape[1], dtype=torch.int32, device=points.device)
        index = index + (self.channels.shape[1] * joints).repeat(len(points))[:, None]
        found = weighted_rows(self.channels.reshape(-1, 1), index, weights)
        return found.view(points.shape[:2]) * inside

    def of_joints(
        self, joints: Int[Tensor, "N"], points: Float[Tensor, "N 3"]
    ) -> Float[Tensor, "N"]:
        """Weight of one joint at each canonical point, all within the box."""
        index, weights = corners(to_grid(points, self.low, self.high, self.shape), self.shape)
        index = index + (self.channels.shape[1] * joints).to(torch.int32)[:, None]
        return weighted_rows(self.channels.reshape(-1, 1), index, weights)[:, 0]

    def of_joint(self, joint: int, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        """Weight of one joint at canonical points within the box."""
        index, weights = corners(to_grid(points, self.low, self.high, self.shape), self.shape)
        return weighted_rows(self.channels[joint][:, None], index, weights)[:, 0]


def rotations(axis_angle: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Rodrigues' formula; its gradient is finite at zero."""
    squared = (axis_angle * axis_angle).sum(-1)
    small = squared < _SMALL_ANGLE**2
    angle = torch.sqrt(torch.where(small, torch.ones_like(squared), squared))
    sine = torch.where(small, 1.0 - squared / 6.0, torch.sin(angle) / angle)
    versine = torch.where(small, 0.5 - squared / 24.0, (1.0 - torch.cos(angle)) / angle**2)
    x, y, z = axis_angle.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1)
    cross = cross.view(*axis_angle.shape, 3)
    eye = torch.eye(3, dtype=axis_angle.dtype, device=axis_angle.device)
    return eye + sine[..., None, None] * cross + versine[..., None, None] * (cross @ cross)


def skinning_transforms(
    local: Float[Tensor, "K 3 3"],
    root_translation: Float[Tensor, "3"],
    rest_joints: Float[Tensor, "K 3"],
    parents: tuple[int, ...],
) -> Float[Tensor, "K 3 4"]:
    """M_i (rest -> world) of local joint rotations; differentiable twin of Skeleton's."""
    turned: list[Tensor] = []
    placed: list[Tensor] = []
    for joint, parent in enumerate(parents):
        if parent < 0:
            turned.append(local[joint])
            placed.append(rest_joints[joint] + root_translation)
            continue
        bone = rest_joints[joint] - rest_joints[parent]
        turned.append(turned[parent] @ local[joint])
        placed.append(placed[parent] + turned[parent] @ bone)
    rotation, position = torch.stack(turned), torch.stack(placed)
    offset = position - (rotation @ rest_joints[:, :, None])[..., 0]
    return torch.cat([rotation, offset[..., None]], dim=-1)


def inverse_skinning(
    points: Float[Tensor, "N 3"], transforms: Float[Tensor, "K 3 4"], volume: WeightVolume
) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N"]]:
    """Canonical points and likelihoods of world points, by 24 look-ups each.

    Differentiable in points, transforms and the volume's rows.
    """
    rotation, offset = transforms[..., :3], transforms[..., 3]
    # M rigid: x_i = R^T (x - t)
    near = torch.einsum("nkj,kji->nki", points[:, None] - offset, rotation)
    own = volume.of_each_joint(near)
    total = own.sum(dim=1)
    canonical = (own[..., None] * near).sum(dim=1) / total.clamp(min=_LEAST_WEIGHT)[:, None]
    return canonical, total.clamp(max=1.0)


def reached_skinning(
    points: Float[Tensor, "N 3"],
    transforms: Float[Tensor, "K 3 4"],
    volume: WeightVolume,
    boxes: tuple[Float[Tensor, "K 3"], Float[Tensor, "K 3"]],
) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N"]]:
    """The same, asking joint k only about points that it brings into its canonical box (low and
    high corners, m): outside, its weight must be nil."""
    rotation, offset = transforms[..., :3], transforms[..., 3]
    low = torch.maximum(boxes[0], volume.low)
    high = torch.minimum(boxes[1], volume.high)
    # all M_i^-1 x in one product: x [R_1 .. R_K] - [t_1 R_1 .. t_K R_K]
    turned = rotation.permute(1, 0, 2).reshape(3, -1)
    shifted = torch.einsum("kj,kji->ki", offset, rotation).reshape(-1)
    near = torch.addmm(-shifted, points, turned).view(-1, 3)
    candidates = near.view(len(points), len(transforms), 3)
    inside = ((candidates >= low) & (candidates <= high)).all(dim=2)
    point, joint = torch.nonzero(inside, as_tuple=True)
    near = near[point * len(transforms) + joint]
    weight = volume.of_joints(joint, near)
    total = points.new_zeros(len(points)).index_add(0, point, weight)
    moved = torch.zeros_like(points).index_add(0, point, weight[:, None] * near)
    return moved / total.clamp(min=_LEAST_WEIGHT)[:, None], total.clamp(max=1.0)


def blended_inverse(
    points: Float[Tensor, "N 3"],
    transforms: Float[Tensor, "K 3 4"],
    weights: Float[Tensor, "N K"],
) -> Float[Tensor, "N 3"]:
    """(sum_k w_k M_k)^-1 x: where linear blend skinning with these weights came from.

    One fixed-point round of x = sum_k w_k(p) M_k p, solved for p with the weights of the last p.
    Differentiable in points and transforms. Places without weight stay where they are.
    """
    blend = _blend(transforms, weights)
    a, b, c = blend[:, :, 0], blend[:, :, 1], blend[:, :, 2]
    # rows of the inverse of [a b c] by cross products; its determinant is near 1 but where bones
    # fold onto each other
    determinant = (a * torch.linalg.cross(b, c)).sum(dim=1, keepdim=True)
    safe = torch.where(determinant.abs() < 0.05, torch.full_like(determinant, 0.05), determinant)
    moved = points - blend[:, :, 3]
    solved = torch.stack(
        [
            (torch.linalg.cross(b, c) * moved).sum(dim=1),
            (torch.linalg.cross(c, a) * moved).sum(dim=1),
            (torch.linalg.cross(a, b) * moved).sum(dim=1),
        ],
        dim=1,
    )
    some = weights.sum(dim=1, keepdim=True) > _LEAST_WEIGHT
    return torch.where(some, solved / safe, points)


def blended(
    canonical: Float[Tensor, "N 3"],
    transforms: Float[Tensor, "K 3 4"],
    weights: Float[Tensor, "N K"],
) -> Float[Tensor, "N 3"]:
    """sum_k w_k M_k p: linear blend skinning, with weights brought to a sum of one."""
    blend = _blend(transforms, weights)
    return (blend[:, :, :3] @ canonical[:, :, None])[..., 0] + blend[:, :, 3]


def _blend(
    transforms: Float[Tensor, "K 3 4"], weights: Float[Tensor, "N K"]
) -> Float[Tensor, "N 3 4"]:
    share = weights / weights.sum(dim=1, keepdim=True).clamp(min=_LEAST_WEIGHT)
    return (share @ transforms.reshape(len(transforms), 12)).view(-1, 3, 4)
