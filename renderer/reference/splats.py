"""The plain torch twin of `renderer/splats`: every splat against every pixel, in any precision."""

from __future__ import annotations

import torch

from renderer.splats.layout import (
    BOX_FILTER_PX2,
    COLOUR,
    FAINTEST,
    LEAST_AREA_PX4,
    LOG_SCALE,
    MOST_OPAQUE,
    NEAR_M,
    OPACITY,
    POSITION,
    ROTATION,
)
from scene.arrays import Float, Int, Tensor


def skin_and_project(
    parameters: Float[Tensor, "N 14"],
    blend_weights: Float[Tensor, "N K"],
    transforms: Float[Tensor, "K 4 4"],
    camera: Float[Tensor, "4 4"],
    dilation: float,
) -> tuple[Float[Tensor, "N 2"], Float[Tensor, "N 2 2"], Float[Tensor, "N"]]:
    """Centres (px), covariances (px^2) on the picture and depths (m); `camera` as `pack_camera`."""
    blended = torch.einsum("nk,kij->nij", blend_weights, transforms[:, :3])
    rest = parameters[:, POSITION : POSITION + 3]
    linear = blended[:, :, :3]
    world = torch.einsum("nij,nj->ni", linear, rest) + blended[:, :, 3]
    rotation = camera[:3, :3]
    point = world @ rotation.T + camera[:3, 3]
    x, y, z = point.unbind(-1)
    fx, fy, cx, cy = camera[3]
    nil = torch.zeros_like(x)
    jacobian = torch.stack(
        [
            torch.stack([fx / z, nil, -fx * x / z**2], -1),
            torch.stack([nil, fy / z, -fy * y / z**2], -1),
        ],
        dim=1,
    )
    scales = torch.exp(parameters[:, LOG_SCALE : LOG_SCALE + 3])
    turned = quaternion_matrix(parameters[:, ROTATION : ROTATION + 4])
    spread = jacobian @ rotation @ linear @ (turned * scales[:, None, :])
    covariance = spread @ spread.mT + dilation * torch.eye(2, dtype=parameters.dtype)
    return torch.stack([fx * x / z + cx, fy * y / z + cy], -1), covariance, z


def expressed(
    parameters: Float[Tensor, "N 14"],
    splats: Int[Tensor, "M"],
    offsets: Float[Tensor, "M S 3"],
    blend_shape_weights: Float[Tensor, "S"],
) -> Float[Tensor, "N 14"]:
    """`parameters` with `splats` moved at rest by the sum of each weight times its offset."""
    moved = parameters.clone()
    place = slice(POSITION, POSITION + 3)
    moved[splats, place] = parameters[splats, place] + torch.einsum(
        "s,msx->mx", blend_shape_weights, offsets
    )
    return moved


def quaternion_matrix(wxyz: Float[Tensor, "N 4"]) -> Float[Tensor, "N 3 3"]:
    """Rotation matrices of quaternions of any length."""
    w, x, y, z = torch.nn.functional.normalize(wxyz, dim=-1).unbind(-1)
    rows = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
        torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
        torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
    ]
    return torch.stack(rows, dim=1)


def draw(
    parameters: Float[Tensor, "N 14"],
    blend_weights: Float[Tensor, "N K"],
    transforms: Float[Tensor, "K 4 4"],
    camera: Float[Tensor, "4 4"],
    width: int,
    height: int,
    dilation: float,
) -> Float[Tensor, "H W 4"]:
    """Premultiplied sRGB and alpha by front-to-back blending, one splat after the other."""
    mean, covariance, depth = skin_and_project(
        parameters, blend_weights, transforms, camera, dilation
    )
    conic = torch.linalg.inv(covariance)
    bare = torch.linalg.det(covariance - BOX_FILTER_PX2 * torch.eye(2, dtype=parameters.dtype))
    kept = torch.sqrt(bare.clamp(min=LEAST_AREA_PX4) / torch.linalg.det(covariance))
    opacity = kept * torch.sigmoid(parameters[:, OPACITY])
    v, u = torch.meshgrid(
        torch.arange(height, dtype=parameters.dtype) + 0.5,
        torch.arange(width, dtype=parameters.dtype) + 0.5,
        indexing="ij",
    )
    pixels = torch.stack([u, v], dim=-1)
    through = torch.ones((height, width), dtype=parameters.dtype)
    colour = torch.zeros((height, width, 3), dtype=parameters.dtype)
    for i in torch.argsort(depth).tolist():
        if depth[i] <= NEAR_M or opacity[i] <= FAINTEST:
            continue
        away = pixels - mean[i]
        power = -0.5 * torch.einsum("hwi,ij,hwj->hw", away, conic[i], away)
        alpha = torch.clamp(opacity[i] * torch.exp(power), max=MOST_OPAQUE)
        weight = alpha * through
        colour = colour + weight[..., None] * parameters[i, COLOUR : COLOUR + 3]
        through = through - weight
    return torch.cat([colour, (1.0 - through)[..., None]], dim=-1)
