"""The plain twin of `renderer/relighting/shading_kernels.py`: whole arrays, one formula a line."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float
from scene.colour import to_srgb
from scene.lighting import Lighting


def shade(
    albedo: Float[Array, "N 3"],
    rest: Float[Array, "N 3"],
    normals: Float[Array, "N 3"],
    joints: Array,
    weights: Float[Array, "N 4"],
    transforms: Float[Array, "K 4 4"],
    eye: Float[Array, "3"],
    lighting: Lighting,
) -> Float[Array, "N 3"]:
    """sRGB of splats of linear `albedo`, posed by `transforms`, in `lighting`, seen from `eye`.

    Normals that point away from there are mirrored: what shines through from the far side stands
    for what lies before it.
    """
    blended = np.einsum("ns,nsij->nij", weights, transforms[joints][:, :, :3])
    posed = np.einsum("nij,nj->ni", blended[:, :, :3], normals)
    posed /= np.linalg.norm(posed, axis=1, keepdims=True)
    view = eye - np.einsum("nij,nj->ni", blended[:, :, :3], rest) - blended[:, :, 3]
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    posed = posed - 2.0 * np.minimum((posed * view).sum(axis=1, keepdims=True), 0.0) * view
    return to_srgb(albedo * lighting.shading(posed))
