"""Hair that no frame shows, drawn as strands: one guessed tone all over looks like a helmet.

Each splat of it becomes several narrow ones beside each other along the way hair falls. Their tones
differ across that way, as much as those of neighbours in hair that frames show: in locks where hair
is long enough to hang, else from hair to hair alone, since locks on a short-haired head are braids.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from renderer.splats.expressions import moving_rows
from renderer.splats.layout import COLOUR, LOG_SCALE, POSITION, ROTATION
from renderer.splats.model import SplatModel
from renderer.splats.training.hair import Hair
from renderer.splats.training.neighbours import mean_of_neighbours
from renderer.splats.training.surface_kinds import KINDS, surface_kinds
from scene.arrays import Array, Float
from scene.rotations import matrix_to_quaternion, quaternion_to_matrix
from scene.skeleton import HEAD

_SCALP = KINDS.index("scalp")
_STRANDS = 6
"""In the place of a splat."""
_WIDTH = 0.29
"""Of a strand, as a share of the splat's deviation."""
_REACH = 0.7
"""How far from the splat's centre strands lie, as a share of its deviation, to all sides."""
_WIDE_M = 0.004
"""Deviation, both ways, from which a splat is no strand yet."""
_WAVES_EACH = 3
_DRIFT_M = (0.05, 0.12)
"""Lengths, down the head, that it wanders at."""
_GRAIN = 0.4
"""Of each strand by itself, as a share of the waves."""
_RADIUS_M = 0.09
"""Of a head: angles round it become metres."""
_LEVEL = 0.1
"""Share of the way backwards in that downwards, so that the crown has one, too."""
_LOCAL_ROUNDS = 4
_GREY = np.array([0.3, 0.6, 0.1])


@dataclass(frozen=True)
class _Cut:
    """How hair of a length lies."""

    length: float
    """Of a strand, as a share of the splat's deviation."""
    contrast: float
    """Tones of strands against those of splats that were trained, for strands overlap more."""
    waves_m: tuple[float, ...]
    """Across the head, that tones are made of."""
    drift: float
    """How far a wave wanders as hair falls, as a share of its length."""


_LONG = _Cut(0.8, 1.2, (0.004, 0.008, 0.016, 0.03), 0.3)
"""Six strands reach as far as the splat did, and outlines do not fray; waves go up to a lock."""
_SHORT = _Cut(0.65, 0.8, (0.003, 0.005), 1.0)
_COLOURS, _PLACE = slice(COLOUR, COLOUR + 3), slice(POSITION, POSITION + 3)
_TURN, _SIZE = slice(ROTATION, ROTATION + 4), slice(LOG_SCALE, LOG_SCALE + 2)


def with_strands(model: SplatModel, hair: Hair) -> SplatModel:
    """`model` with strands in the place of wide splats that no frame shows: those of the scalp, and
    those that `hair` covers. The same model gets the same strands."""
    rest = model.parameters[:, _PLACE]
    scalp = surface_kinds(rest, model.joints, model.weights, model.skeleton) == _SCALP
    cut = _LONG if hair.long else _SHORT
    wide = np.exp(model.parameters[:, _SIZE].min(axis=1)) > _WIDE_M
    guessed = ~model.seen & wide & (scalp | hair.covered)
    contrast = cut.contrast * _contrast(model.parameters[scalp & model.seen])
    if contrast == 0.0 or not guessed.any():
        return model
    chance = np.random.default_rng(0)
    kept, rows = np.flatnonzero(~guessed), np.flatnonzero(guessed)
    origins = np.concatenate([kept, np.repeat(rows, _STRANDS)])
    parameters, strands = model.parameters[origins], slice(len(kept), None)
    joint = model.skeleton.rest_joints[HEAD]
    parameters[strands] = _laid_beside(parameters[strands], joint, cut.length, chance)
    places = parameters[strands, _PLACE] - joint
    tones = np.clip(1.0 + contrast * _tones(places, cut, chance), 0.0, 2.0)[:, None]
    parameters[strands, _COLOURS] *= tones
    albedo = model.albedo
    if albedo is not None:
        albedo = albedo[origins]
        albedo[strands] = np.clip(albedo[strands] * tones**2, 0.0, 1.0)
    moving, moves = moving_rows(model.expression_splats, origins, len(model))
    return replace(
        model,
        parameters=parameters,
        joints=model.joints[origins],
        weights=model.weights[origins],
        seen=model.seen[origins],
        albedo=albedo,
        normals=None if model.normals is None else model.normals[origins],
        quads=model.quads[origins],
        expression_splats=moving,
        expression_offsets=model.expression_offsets[moves],
    )


def _contrast(seen: Float[Array, "S P"]) -> float:
    """Typical difference of a tone from those beside it, as a share of them."""
    if len(seen) < 2:
        return 0.0
    tones = seen[:, _COLOURS] @ _GREY
    local, mean = tones, mean_of_neighbours(seen[:, _PLACE])
    for _ in range(_LOCAL_ROUNDS):
        local = 0.5 * (local + mean @ local)
    shares = (tones - local) / np.maximum(local, 0.05)
    return float(np.subtract(*np.percentile(shares, (84.0, 16.0)))) / 2.0


def _laid_beside(
    splats: Float[Array, "K P"],
    joint: Float[Array, "3"],
    length: float,
    chance: np.random.Generator,
) -> Float[Array, "K P"]:
    """Copies of flat splats, narrowed and spread beside each other, along the way hair falls."""
    laid = splats.copy()
    out = quaternion_to_matrix(splats[:, _TURN].astype(np.float64))[:, :, 2]
    out *= np.sign(np.einsum("kx,kx->k", out, splats[:, _PLACE] - joint))[:, None] + 1e-9
    falls = np.array([0.0, -1.0, -_LEVEL])
    along = falls - (out @ falls)[:, None] * out
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    across = np.cross(along, out)
    laid[:, _TURN] = matrix_to_quaternion(np.stack([across, along, out], axis=-1))
    deviation = np.exp(splats[:, _SIZE]).mean(axis=1)
    reach = _REACH * deviation[:, None] * chance.uniform(-1.0, 1.0, (len(splats), 2))
    laid[:, _PLACE] += reach[:, :1] * across + reach[:, 1:] * along
    laid[:, _SIZE] = np.log(deviation[:, None] * (_WIDTH, length))
    return laid


def _tones(
    places: Float[Array, "K 3"], cut: _Cut, chance: np.random.Generator
) -> Float[Array, "K"]:
    """Of mean nil and deviation one, along the way hair falls about alike.

    Args:
        places: from the head's joint.
    """
    round_m = _RADIUS_M * np.arctan2(places[:, 0], -places[:, 2])
    tones = np.zeros(len(places))
    for wave_m in np.repeat(cut.waves_m, _WAVES_EACH):
        phase, drift_phase = chance.uniform(0.0, 2.0 * np.pi, 2)
        length_m, drift_m = wave_m * chance.uniform(0.8, 1.25), chance.uniform(*_DRIFT_M)
        drift = cut.drift * wave_m * np.sin(2.0 * np.pi * places[:, 1] / drift_m + drift_phase)
        tones += np.sin(2.0 * np.pi * (round_m + drift) / length_m + phase)
    tones /= max(tones.std(), 1e-9)
    tones += _GRAIN * chance.standard_normal(len(tones))
    return (tones - tones.mean()) / max(tones.std(), 1e-9)
