"""Relighting of splats: by the room's light, or by the clip's own as the body moves.

Every splat has an albedo and a normal, which `light_estimation` finds when a model is trained.
Without, the shortest axis of a flat splat approximates the normal: training initialises it along
the surface's and perturbs it, so the mean over neighbours is taken. In each picture normals rotate
with the body.
"""

from __future__ import annotations

from collections.abc import Sequence as Many
from functools import cache
from weakref import WeakKeyDictionary

import numpy as np

from renderer.splats.layout import COLOUR, NO_LIGHT, POSITION, ROTATION
from renderer.splats.skinned import SkinnedSplats
from scene.arrays import Array, Float, Int
from scene.colour import to_linear, to_srgb
from scene.lighting import Lighting

_NEIGHBOURS = 16
"""Splats whose normals are averaged; at 10,000 a person they lie within 3 cm."""
_SAME_SIDE = 0.3
"""Cosine from which a neighbour lies on the same side: a finger's back is not its front."""
_TABLE_STEPS = 1024


class Relighting:
    """Colours of a set of models in any light; keep it as long as the set stays."""

    def __init__(self, models: Many[SkinnedSplats]) -> None:
        self._albedo = np.concatenate([albedo_of(m) for m in models]).astype(np.float32)
        self._normals = np.concatenate([normals_of(m) for m in models]).astype(np.float32)
        lights = [None if m.light is None else m.light.astype(np.float32) for m in models]
        self._lit_models = [model for model, light in enumerate(lights) if light is not None]
        self._lights = np.array([light for light in lights if light is not None], np.float32)
        index_of_model = {model: place for place, model in enumerate(self._lit_models)}
        self._light_index = np.concatenate(
            [
                np.full(len(m.parameters), index_of_model.get(n, NO_LIGHT))
                for n, m in enumerate(models)
            ]
        ).astype(np.uint8)
        self._first_light = np.zeros(len(self._light_index), np.uint8)

    def shade(
        self,
        parameters: Float[Array, "N P"],
        joints: Array,
        weights: Float[Array, "N 4"],
        transforms: Float[Array, "K 4 4"],
        eye: Float[Array, "3"],
        lighting: Lighting,
    ) -> None:
        """Write every splat's colour in `lighting`, posed by `transforms` and seen from `eye` (m,
        world), into `parameters`."""
        from renderer.relighting.shading_kernels import shade

        shade(
            self._albedo,
            self._normals,
            joints,
            weights,
            transforms,
            eye.astype(np.float32),
            self._first_light,
            lighting.harmonics[None].astype(np.float32),
            IDENTITY_ROTATION,
            lighting.key_direction.astype(np.float32),
            lighting.key_colour.astype(np.float32),
            srgb_table(),
            parameters,
        )

    def shade_as_captured(
        self,
        parameters: Float[Array, "N P"],
        joints: Array,
        weights: Float[Array, "N 4"],
        transforms: Float[Array, "K 4 4"],
        eye: Float[Array, "3"],
        placements: Many[Float[Array, "4 4"]],
    ) -> None:
        """As `shade`, each model in the light of its own clip, rotated into the room by its rigid
        `placements`; colours of models without a light stay."""
        from renderer.relighting.shading_kernels import shade

        world_to_clip = np.array(
            [placements[model][:3, :3].T for model in self._lit_models], np.float32
        )
        shade(
            self._albedo,
            self._normals,
            joints,
            weights,
            transforms,
            eye.astype(np.float32),
            self._light_index,
            self._lights,
            world_to_clip,
            NO_KEY_LIGHT,
            NO_KEY_LIGHT,
            srgb_table(),
            parameters,
        )


NO_KEY_LIGHT = np.zeros(3, np.float32)
IDENTITY_ROTATION = np.eye(3, dtype=np.float32)[None]


@cache
def srgb_table() -> Float[Array, "S"]:
    """sRGB by the root of linear light, from 0 to 1: nearly straight."""
    roots = np.linspace(0.0, 1.0, _TABLE_STEPS + 1)
    return to_srgb(roots**2).astype(np.float32)


def albedo_of(model: SkinnedSplats) -> Float[Array, "N 3"]:
    """Linear albedo; of a model without, its colours as if captured in uniform white light."""
    if model.albedo is not None:
        return model.albedo
    return to_linear(np.clip(model.parameters[:, COLOUR : COLOUR + 3], 0.0, 1.0))


def normals_of(model: SkinnedSplats) -> Float[Array, "N 3"]:
    """Outward unit normals at rest: the surface's, or those that its splats have by themselves.

    These are computed once and cached as long as `model` lives.
    """
    if model.normals is not None:
        return model.normals
    if model not in _NORMALS:
        rest = model.parameters[:, POSITION : POSITION + 3]
        near, _ = neighbours(rest, rest, _NEIGHBOURS)
        _NORMALS[model] = smooth_normals(model.parameters, near)
    return _NORMALS[model]


_NORMALS: WeakKeyDictionary[SkinnedSplats, Float[Array, "N 3"]] = WeakKeyDictionary()


def smooth_normals(parameters: Float[Array, "N P"], near: Int[Array, "N M"]) -> Float[Array, "N 3"]:
    """Mean of the splats' third axes over the rows `near` that lie on the same side."""
    quaternions = parameters[:, ROTATION : ROTATION + 4]
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    axis = np.stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)], 1)
    return same_side_mean(axis, axis[near])


def same_side_mean(
    normals: Float[Array, "N 3"], around: Float[Array, "N M 3"]
) -> Float[Array, "N 3"]:
    """Unit mean of those `around` each of unit `normals` that lie on the same side; itself, where
    none does."""
    same_side = (around * normals[:, None]).sum(axis=2, keepdims=True) > _SAME_SIDE
    mean = (around * same_side).sum(axis=1) + 1e-6 * normals
    return (mean / np.linalg.norm(mean, axis=1, keepdims=True)).astype(np.float32)


def neighbours(
    points: Float[Array, "N 3"], among: Float[Array, "V 3"], count: int
) -> tuple[Int[Array, "N M"], Float[Array, "N M"]]:
    """The `count` rows of `among` nearest to each point, and their distances, the nearest first."""
    from scipy.spatial import KDTree

    count = min(count, len(among))
    distance, index = KDTree(among).query(points, k=count)
    shape = (len(points), count)
    return np.reshape(index, shape), np.reshape(distance, shape).astype(np.float32)
