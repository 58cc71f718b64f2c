"""Splats as tensors of a model file, and as a .ply that other viewers open.

Positions keep float32 (a millimetre matters); the rest is float16, a quarter of a megabyte for 10k.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.splats.expressions import no_offsets, no_splats
from renderer.splats.layout import LOG_SCALE, PARAMETERS, POSITION
from renderer.splats.model import SplatModel
from scene.arrays import Array
from scene.motion import Motion
from scene.skeleton import Skeleton

_SURFACE = ("albedo", "normals")
"""Tensors of models whose light is known."""


def pack(model: SplatModel) -> dict[str, Array]:
    """Tensors of `model`."""
    surface = {name: getattr(model, name) for name in _SURFACE}
    return {
        **{name: of.astype(np.float16) for name, of in surface.items() if of is not None},
        **({} if model.light is None else {"light": model.light.astype(np.float32)}),
        "positions": model.parameters[:, POSITION : POSITION + 3].astype(np.float32),
        "appearance": model.parameters[:, LOG_SCALE:].astype(np.float16),
        "joints": model.joints,
        "weights": model.weights.astype(np.float16),
        "seen": model.seen,
        **(_expressions(model) if len(model.expression_splats) else {}),
    }


def _expressions(model: SplatModel) -> dict[str, Array]:
    return {
        "expression_splats": model.expression_splats.astype(np.uint32),
        "expression_offsets": model.expression_offsets.astype(np.float16),
    }


def unpack(
    tensors: dict[str, Array], about: dict[str, Any], skeleton: Skeleton, motion: Motion
) -> SplatModel:
    """The model that `pack` took apart."""
    positions = tensors["positions"]
    parameters = np.empty((len(positions), PARAMETERS), np.float32)
    parameters[:, POSITION : POSITION + 3] = positions
    parameters[:, LOG_SCALE:] = tensors["appearance"]
    weights = tensors["weights"].astype(np.float32)
    splats = tensors.get("expression_splats", no_splats()).astype(np.int32)
    offsets = tensors.get("expression_offsets", no_offsets()).astype(np.float32)
    return SplatModel(
        parameters,
        tensors["joints"],
        weights / weights.sum(axis=1, keepdims=True),
        tensors["seen"].astype(bool),
        skeleton,
        motion,
        about["data_hash"],
        about["preset"],
        about["metrics"],
        **{name: tensors[name].astype(np.float32) for name in _SURFACE if name in tensors},
        light=tensors.get("light"),
        expression_splats=splats,
        expression_offsets=offsets,
    )
