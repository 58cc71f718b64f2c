"""The plain twin of `renderer/relight_kernels.py`: whole arrays, one formula a line."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float
from scene.colour import to_srgb
from scene.lighting import Lighting


def shade(
    albedo: Float[Array, "N 3"],
    normals: Float[Array, "N 3"],
    joints: Array,
    weights: Float[Array, "N 4"],
    transforms: Float[Array, "K 4 4"],
    lighting: Lighting,
) -> Float[Array, "N 3"]:
    """sRGB colours of splats of linear `albedo`, posed by `transforms`, in `lighting`."""
    turns = np.einsum("ns,nsij->nij", weights, transforms[joints][:, :, :3, :3])
    posed = np.einsum("nij,nj->ni", turns, normals)
    posed /= np.linalg.norm(posed, axis=1, keepdims=True)
    return to_srgb(albedo * lighting.shading(posed))
