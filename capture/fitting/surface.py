"""Places of the body's surface that the fit looks at, at rest and posed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from capture.body.model import BodyModel
from capture.fitting.kinematics import blend_rows, blend_transforms, skinned_points
from capture.fitting.observations import sampled_vertices
from scene.arrays import Array, Float, Int, Tensor
from scene.body import vertex_normals


@dataclass(frozen=True, eq=False)
class Skin:
    """Some vertices of a body model, spread evenly over it."""

    rest: Float[Tensor, "V 3"]
    directions: Float[Tensor, "V 3 B"]
    """Metres a unit of each shape number."""
    weights: Float[Tensor, "V 24"]
    normals: Float[Tensor, "V 3"]
    """At rest, outwards."""
    owners: Int[Tensor, "V"]
    """The joint that moves each most."""

    @classmethod
    def of(cls, model: BodyModel, spacing_m: float) -> Skin:
        """One vertex for each cell of a grid."""
        return cls.at(model, sampled_vertices(model.rest_vertices, spacing_m))

    @classmethod
    def at(cls, model: BodyModel, chosen: Int[Array, "V"]) -> Skin:
        """The vertices `chosen`."""

        def tensor(value: Array) -> Tensor:
            return torch.tensor(value, dtype=torch.float32)

        faces = model.body(np.zeros(model.shape_count)).faces
        assert faces is not None
        weights = model.blend_weights[chosen]
        return cls(
            tensor(model.rest_vertices[chosen]),
            tensor(model.vertex_directions[chosen]),
            tensor(weights),
            tensor(vertex_normals(model.rest_vertices, faces)[chosen]),
            torch.tensor(weights.argmax(axis=1)),
        )

    def posed(
        self, turned: Float[Tensor, "F 24 3 3"], placed: Float[Tensor, "F 24 3"],
        rest_joints: Float[Tensor, "24 3"], shape: Float[Tensor, "B"],
    ) -> Float[Tensor, "F V 3"]:  # fmt: skip
        """All vertices in every frame."""
        return skinned_points(
            turned, placed, rest_joints, self.rest + self.directions @ shape, self.weights
        )

    def posed_at(
        self, which: Int[Tensor, "F P"], turned: Float[Tensor, "F 24 3 3"],
        placed: Float[Tensor, "F 24 3"], rest_joints: Float[Tensor, "24 3"],
        shape: Float[Tensor, "B"],
    ) -> Float[Tensor, "F P 3"]:  # fmt: skip
        """Those vertices that each frame asks for."""
        points = (self.rest + self.directions @ shape)[which]
        rows = blend_rows(points, self.weights[which])
        columns = blend_transforms(turned, placed, rest_joints).permute(0, 1, 3, 2).flatten(1, 2)
        return rows @ columns

    def turned_normals(self, turned: Float[Tensor, "F 24 3 3"]) -> Float[Tensor, "F V 3"]:
        """Normals as each vertex' own joint turns them."""
        return (turned[:, self.owners] @ self.normals[..., None])[..., 0]
