"""Estimates the light of a clip from its frames.

Motion exposes each splat to the light from many sides: where its brightness varies, the albedo is
constant and the irradiance differs. Letters: a splat i
with albedo a_i was seen in observations k, colour c_k (linear) on normal n_k; light is
E(n) = Y(n).H with the nine harmonics Y of `scene.lighting`, a channel at a time. The fit minimises

    sum_k w_k (c_k / a_i - E(n_k))^2  +  pairs of neighbours (log a_i - log a_j)^2  +  ridge on H

by Gauss-Newton with a_i eliminated (variable projection, Kaufman 1975), both sums robust (Cauchy):
neighbours mostly share one material, so differences between their colours are light. That
determines light from above and below, which turning does not; edges of clothes are outliers.
Observations at grazing angles are left out: there, pixels mix neighbouring surfaces.

Frames do not determine the scale and tint that light and albedo share: light is assumed to be white
on the mean, as cameras balance it, and so strong that white on the brightest side is white, as they
expose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from renderer.relighting.captured_light import CapturedLight
from renderer.relighting.shading import neighbours, normals_of, same_side_mean
from renderer.splats.layout import BOX_FILTER_PX2, POSITION
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.workspace import Workspace
from scene.arrays import Array, Float, Int
from scene.body import Body, vertex_normals
from scene.camera import Camera
from scene.colour import to_linear
from scene.environment import exposure
from scene.lighting import HARMONICS, LUMINANCE, Lighting, harmonic_basis
from scene.motion import Pose
from scene.sequence import Sequence

_FRAMES = 30
_GRAZING, _FACING = 0.3, 0.6
"""Cosine between normal and view up to which an observation has no weight, and from which full."""
_CLIPPED, _BLACK = 0.98, 0.02
"""sRGB values from which a channel, and up to which every channel, is unusable."""
_PAIR_RANKS = (16, 24, 32, 40, 48)
"""Which of a splat's nearest others it is paired with: near enough to wear the same."""
_VERTICES = 8
"""Of the surface, nearest to a splat, whose normals make up its own."""
_ITERATIONS = 8
_RELATIVE, _LOG_RATIO = 0.2, 0.1
"""Deviations in light and in log albedo from which an observation, or a pair, counts less."""
_PAIR_WEIGHT = 20.0
"""In pixels."""
_RIDGE = 1e-3
"""Weight of even light, as a share of all pixels."""
_MIN_LIGHT = 0.05
_MAX_ALBEDO = 0.9
"""Linear; hardly any clothes are lighter: where the fit says so, the light was stronger."""


@dataclass(frozen=True, eq=False)
class _Observations:
    """Observations in the frames: k runs over pairs of splat and frame."""

    splat: Int[Array, "k"]
    pixels: Float[Array, "k"]
    """Their number, less at grazing angles."""
    colour: Float[Array, "k 3"]
    """Linear."""
    basis: Float[Array, "k 9"]
    """Y of the normals."""


def estimate_light(model: SplatModel, sequence: Sequence) -> CapturedLight | None:
    """The light of `sequence`, on which `model` was trained; None without usable observations."""
    rest = model.parameters[:, POSITION : POSITION + 3]
    near, _ = neighbours(rest, rest, _PAIR_RANKS[-1] + 1)
    normals = _normals(model, sequence.body)
    observations, mean_basis = _observe(model, sequence, normals)
    if not len(observations.splat):
        return None
    harmonics, albedo, known = _fit(observations, near, len(model))
    light = Lighting(harmonics, np.array([0.0, 1.0, 0.0]), np.zeros(3))
    brightest = float(np.percentile((albedo @ LUMINANCE)[known], 99.0))
    harmonics = harmonics * max(exposure(light), brightest / _MAX_ALBEDO)
    mean = np.maximum(mean_basis @ harmonics, _MIN_LIGHT).astype(np.float32)
    return CapturedLight(harmonics, normals, mean)


def _normals(model: SplatModel, body: Body) -> Float[Array, "N 3"]:
    """The splats' own, made exact by the body's surface where that lies on the same side: in the
    head, another one does not."""
    own = normals_of(model)
    if body.rest_vertices is None or body.faces is None:
        return own
    rest = model.parameters[:, POSITION : POSITION + 3]
    near, _ = neighbours(rest, body.rest_vertices, _VERTICES)
    return same_side_mean(own, vertex_normals(body.rest_vertices, body.faces)[near])


def _observe(
    model: SplatModel, sequence: Sequence, normals: Float[Array, "N 3"]
) -> tuple[_Observations, Float[Array, "N 9"]]:
    """Observations of every splat, and the mean of Y over all frames as far as they saw it."""
    source, work = sequence.train, Workspace(len(model))
    parts, total, share = [], np.zeros((len(model), HARMONICS)), np.zeros(len(model))
    frames = np.unique(np.linspace(0, len(source) - 1, _FRAMES).round().astype(int))
    for frame in frames.tolist():
        camera, pose = source.camera(frame), model.motion.pose_at(source.pose(frame).time_s)
        transforms = _transforms(model, pose)
        posed, facing = _posed_normals(model, normals, transforms, camera)
        basis = harmonic_basis(posed)
        total += np.maximum(facing, 0.0)[:, None] * basis
        share += np.maximum(facing, 0.0)
        front = work.front(
            model.parameters,
            model.joints.astype(np.uint16),
            model.weights,
            transforms,
            camera,
            BOX_FILTER_PX2,
        )
        image = source.image(frame)
        clear = (image < _CLIPPED).all(axis=2) & (image > _BLACK).any(axis=2)
        shown = (front >= 0) & (source.mask(frame) > 0.99) & clear
        count = np.bincount(front[shown], minlength=len(model))
        light = to_linear(image[shown].astype(np.float64))
        weight = count * np.clip((facing - _GRAZING) / (_FACING - _GRAZING), 0.0, 1.0)
        rows = np.flatnonzero(weight)
        sums = [np.bincount(front[shown], light[:, j], len(model))[rows] for j in range(3)]
        parts.append((rows, weight[rows], np.stack(sums, axis=1) / count[rows, None], basis[rows]))
    mean = total / np.maximum(share, 1e-9)[:, None]
    mean[share < 1e-6] = mean[share >= 1e-6].mean(axis=0)
    return _Observations(*(np.concatenate(part) for part in zip(*parts, strict=True))), mean


def _fit(
    observations: _Observations, near: Int[Array, "N M"], count: int
) -> tuple[Float[Array, "9 3"], Float[Array, "N 3"], Array]:
    """H, white and 1 on the mean over all directions; the albedo that goes with it; where known."""
    mean_sphere = np.zeros(HARMONICS)
    mean_sphere[0] = 0.282095
    harmonics = np.zeros((HARMONICS, 3))
    harmonics[0] = 1.0 / mean_sphere[0]
    known = np.bincount(observations.splat, observations.pixels, count) > 0.0
    others = near[:, [place for place in _PAIR_RANKS if place < near.shape[1]]]
    first = np.repeat(np.arange(count), others.shape[1])
    both = known[first] & known[others.ravel()]
    first, second = first[both], others.ravel()[both]
    albedo = np.ones((count, 3))
    pair_weight, observation_weight = np.ones(len(first)), np.ones(len(observations.splat))
    for _ in range(_ITERATIONS):
        misfit, contrast = np.zeros(len(observation_weight)), np.zeros(len(pair_weight))
        for j in range(3):
            step = _step(
                observations,
                j,
                harmonics[:, j],
                observation_weight,
                (first, second),
                pair_weight,
                mean_sphere,
                count,
            )
            harmonics[:, j] += step.harmonics
            albedo[:, j] = step.albedo
            misfit, contrast = misfit + step.misfit**2 / 3.0, contrast + step.contrast**2 / 3.0
        observation_weight = 1.0 / (1.0 + misfit / _RELATIVE**2)
        pair_weight = 1.0 / (1.0 + contrast / _LOG_RATIO**2)
    return harmonics, albedo, known


@dataclass(frozen=True, eq=False)
class _Step:
    harmonics: Float[Array, "9"]
    """To be added."""
    albedo: Float[Array, "N"]
    misfit: Float[Array, "k"]
    contrast: Float[Array, "p"]


def _step(
    observations: _Observations,
    channel: int,
    harmonics: Float[Array, "9"],
    observation_weight: Float[Array, "k"],
    pairs: tuple[Array, Array],
    pair_weight: Float[Array, "p"],
    mean_sphere: Float[Array, "9"],
    count: int,
) -> _Step:
    """One Gauss-Newton step of one channel."""
    splat, colour, basis = observations.splat, observations.colour[:, channel], observations.basis
    light = np.maximum(basis @ harmonics, _MIN_LIGHT)
    weight = observations.pixels * observation_weight
    squares = np.maximum(np.bincount(splat, weight * light**2, count), 1e-12)
    albedo = np.maximum(np.bincount(splat, weight * light * colour, count) / squares, 1e-3)
    # d log a_i / dH = -mean_i
    mean = [np.bincount(splat, weight * light * basis[:, h], count) for h in range(HARMONICS)]
    mean = np.stack(mean, axis=1) / squares[:, None]
    misfit = colour / albedo[splat] - light
    jacobian = basis - light[:, None] * mean[splat]
    first, second = pairs
    contrast = np.log(albedo[first]) - np.log(albedo[second])
    between = mean[first] - mean[second]
    # dark albedo has a low signal-to-noise ratio
    weight = weight * np.minimum(albedo[splat] / 0.1, 1.0) ** 2
    matrix = (jacobian * weight[:, None]).T @ jacobian
    vector = jacobian.T @ (weight * misfit)
    paired = _PAIR_WEIGHT * pair_weight
    matrix += (between * paired[:, None]).T @ between
    vector += between.T @ (paired * contrast)
    pixels = observations.pixels.sum()
    ridge = _RIDGE * pixels * np.repeat([0.0, 1.0, 4.0], [1, 3, 5])
    matrix += np.diag(ridge) + 1e3 * pixels * np.outer(mean_sphere, mean_sphere)
    vector += 1e3 * pixels * mean_sphere * (1.0 - mean_sphere @ harmonics) - ridge * harmonics
    return _Step(np.linalg.solve(matrix, vector), albedo, misfit, contrast)


def _transforms(model: SplatModel, pose: Pose) -> Float[Array, "K 4 4"]:
    moved = model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    return moved.astype(np.float32)


def _posed_normals(
    model: SplatModel,
    normals: Float[Array, "N 3"],
    transforms: Float[Array, "K 4 4"],
    camera: Camera,
) -> tuple[Float[Array, "N 3"], Float[Array, "N"]]:
    """Normals in the pose, and their cosines with the way to the camera."""
    blended = np.einsum("ns,nsij->nij", model.weights, transforms[model.joints][:, :, :3])
    posed = np.einsum("nij,nj->ni", blended[:, :, :3], normals)
    posed /= np.maximum(np.linalg.norm(posed, axis=1, keepdims=True), 1e-9)
    rest = model.parameters[:, POSITION : POSITION + 3]
    place = np.einsum("nij,nj->ni", blended[:, :, :3], rest) + blended[:, :, 3]
    away = camera.position - place
    return posed, (posed * away).sum(axis=1) / np.maximum(np.linalg.norm(away, axis=1), 1e-9)
