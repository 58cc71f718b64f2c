"""A person's body at rest: skeleton and, where known, surface with blend weights."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scene.arrays import Array, Float, Int
from scene.checks import require_finite, require_shape
from scene.errors import InvalidInput
from scene.expression import BLEND_SHAPE_COUNT, blend_shape_weights
from scene.motion import Pose
from scene.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Body:
    """What moves: joints, and the skin that follows them by linear blend skinning."""

    skeleton: Skeleton
    rest_vertices: Float[Array, "V 3"] | None = None
    """T-pose surface, m; None where a data set knows joints only."""
    faces: Int[Array, "T 3"] | None = None
    """Triangles, counter-clockwise seen from outside."""
    blend_weights: Float[Array, "V K"] | None = None
    """Weight of each joint for each vertex; rows sum to one."""
    expression_directions: Float[Array, "S V 3"] | None = None
    """Metres at rest that each blend shape (`scene.expression`) at 1 moves the surface; None where
    that is not known."""

    def __post_init__(self) -> None:
        parts = (self.rest_vertices, self.faces, self.blend_weights)
        if all(part is None for part in parts):
            return
        if self.rest_vertices is None or self.faces is None or self.blend_weights is None:
            known = [part is not None for part in parts]
            raise InvalidInput(
                "rest_vertices, faces and blend_weights must be given together; got "
                f"{dict(zip(('rest_vertices', 'faces', 'blend_weights'), known, strict=True))}"
            )
        require_shape("rest_vertices", self.rest_vertices, (None, 3))
        require_shape("faces", self.faces, (None, 3))
        shape = (len(self.rest_vertices), len(self.skeleton.names))
        require_shape("blend_weights", self.blend_weights, shape)
        require_finite("rest_vertices", self.rest_vertices)
        require_finite("blend_weights", self.blend_weights)
        if self.expression_directions is not None:
            sizes = (BLEND_SHAPE_COUNT, len(self.rest_vertices), 3)
            require_shape("expression_directions", self.expression_directions, sizes)
            require_finite("expression_directions", self.expression_directions)
        off = float(np.abs(self.blend_weights.sum(axis=1) - 1.0).max())
        if off > 1e-3:
            raise InvalidInput(
                f"blend_weights must sum to one a vertex; got a sum off by {off:.3g}"
            )
        if self.faces.size and not 0 <= self.faces.min() <= self.faces.max() < shape[0]:
            raise InvalidInput(
                f"faces must index {shape[0]} vertices; got {self.faces.min()}..{self.faces.max()}"
            )

    @property
    def has_surface(self) -> bool:
        """Whether a surface with blend weights is known."""
        return self.rest_vertices is not None

    def on(self, skeleton: Skeleton) -> Body:
        """The same body with the bone lengths of `skeleton`; its surface follows the joints."""
        if self.rest_vertices is None or self.blend_weights is None:
            return replace(self, skeleton=skeleton)
        longer = skeleton.rest_joints - self.skeleton.rest_joints
        surface = self.rest_vertices + self.blend_weights @ longer
        return replace(self, skeleton=skeleton, rest_vertices=surface)

    def posed_vertices(self, pose: Pose) -> Float[Array, "V 3"]:
        """The surface in `pose`, world metres: x = sum_k w_k M_k (x_rest + sum_s e_s d_s).

        e are the weights of the pose's expression, d the body's directions, where it knows any.
        Raises InvalidInput where the body has no surface.
        """
        if self.rest_vertices is None or self.blend_weights is None:
            raise InvalidInput("body must have a surface to be posed; got joints only")
        skinning = self.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
        blended = np.tensordot(self.blend_weights, skinning[:, :3, :], axes=1)
        rest = self.rest_vertices
        if self.expression_directions is not None and pose.expression.any():
            shown = blend_shape_weights(pose.expression)
            rest = rest + np.tensordot(shown, self.expression_directions, axes=1)
        turned = np.einsum("vij,vj->vi", blended[:, :, :3], rest)
        return turned + blended[:, :, 3]


def vertex_normals(vertices: Float[Array, "V 3"], faces: Int[Array, "T 3"]) -> Float[Array, "V 3"]:
    """Unit normals, each the area-weighted mean of its triangles'."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    flat = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(normals, faces[:, i], flat)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
