"""Vertices of the body's surface that the fit compares with pictures, at rest and posed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from capture.body.model import BodyModel
from capture.fitting.kinematics import BlendWeights, PosedBody, skinned_points
from scene.arrays import Array, Float, Int, Tensor
from scene.body import vertex_normals


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Some vertices of a body model, spread evenly over it."""

    rest: Float[Tensor, "V 3"]
    directions: Float[Tensor, "V 3 B"]
    """Metres a unit of each shape number."""
    weights: BlendWeights
    normals: Float[Tensor, "V 3"]
    """At rest, outwards."""
    owners: Int[Tensor, "V"]
    """The joint that moves each most."""

    @classmethod
    def spread(cls, model: BodyModel, spacing_m: float) -> SurfaceSamples:
        """One vertex for each cell of a grid."""
        return cls.at(model, sampled_vertices(model.rest_vertices, spacing_m))

    @classmethod
    def at(cls, model: BodyModel, chosen: Int[Array, "V"]) -> SurfaceSamples:
        """The vertices `chosen`."""

        def tensor(value: Array) -> Tensor:
            return torch.tensor(value, dtype=torch.float32)

        faces = model.body(np.zeros(model.shape_count)).faces
        assert faces is not None
        weights = model.blend_weights[chosen]
        return cls(
            tensor(model.rest_vertices[chosen]),
            tensor(model.vertex_directions[chosen]),
            BlendWeights.of(weights),
            tensor(vertex_normals(model.rest_vertices, faces)[chosen]),
            torch.tensor(weights.argmax(axis=1)),
        )

    def posed(self, posed: PosedBody) -> Float[Tensor, "F V 3"]:
        """All vertices in every frame, m."""
        return skinned_points(posed, self.rest + self.directions @ posed.shape, self.weights)

    def posed_at(self, posed: PosedBody, which: Int[Tensor, "F P"]) -> Float[Tensor, "F P 3"]:
        """Those vertices that each frame asks for, m."""
        rest = self.rest + self.directions @ posed.shape
        return skinned_points(posed, rest, self.weights, which.numpy())

    def normals_of(self, posed: PosedBody) -> Float[Tensor, "F V 3"]:
        """Normals, each rotated with the joint that moves its vertex most."""
        return (posed.global_rotations[:, self.owners] @ self.normals[..., None])[..., 0]


def sampled_vertices(vertices: Float[Array, "V 3"], spacing_m: float) -> Array:
    """Indices of one vertex for each occupied cell of a grid."""
    cells = np.floor(vertices / spacing_m).astype(np.int64)
    return np.sort(np.unique(cells, axis=0, return_index=True)[1])
