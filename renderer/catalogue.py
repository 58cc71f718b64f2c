"""What a preset weighs and what it switches on, told without training it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import torch

from renderer.field.networks.encoding import encoded_size
from renderer.field.networks.mlps import (
    Mlp,
    PoseRefiner,
    ResidualMotion,
    SkeletonMotion,
    parameter_count,
)
from renderer.field.sizes import FieldSizes
from renderer.presets import SPEED_UPS, Preset
from renderer.splats.layout import PARAMETERS
from renderer.splats.settings import SplatSettings
from scene.skeleton import JOINT_COUNT

_SKIN_M2 = 1.8
"""Skin of an adult, which tells about how many grid points a shell has."""
_BYTES = {"table": 2, "learnt": 4, "prior": 1, "baked": 4}
"""Bytes a number in a model file (`renderer.field.model`)."""
_SPLAT_BYTES = PARAMETERS * 2 + 4 + 8 + 1
"""Parameters in half precision, four joints and their weights, and whether it was seen."""


def describe_preset(preset: Preset) -> dict[str, Any]:
    """Parameters of each network, size of the model file in MB, what is on, and all settings.

    Counts are for SMPL's 24 joints and, where a grid clings to the skin, for an adult's; splats are
    counted at most (`SplatSettings.most`), since each clip gets as many as it shows.
    """
    settings = preset.settings
    if isinstance(settings, SplatSettings):
        parameters = {"splats": settings.most * PARAMETERS}
        megabytes, switched_on = settings.most * _SPLAT_BYTES / 1e6, ["splats"]
    else:
        parameters = field_parameters(settings.sizes)
        megabytes = _field_megabytes(settings.sizes, parameters)
        switched_on = _switched_on(settings.sizes)
    return {
        "description": preset.description,
        "parameters": parameters,
        "megabytes": round(megabytes, 2),
        "switches_on": switched_on,
        "settings": asdict(settings),
    }


def field_parameters(sizes: FieldSizes, joints: int = JOINT_COUNT) -> dict[str, int]:
    """Learnt numbers of each network that trains, nil for those left out."""
    with torch.device("meta"):
        volume = torch.ones(joints + 1, *sizes.volume)
        canonical, points = None, 0
        if sizes.grid is None:
            assert sizes.colour is not None
            canonical = Mlp(encoded_size(sizes.octaves, identity=True), 4, sizes.colour)
        else:
            if sizes.colour is not None:
                canonical = Mlp(sizes.grid.channels, 3, sizes.colour)
            thickness = sizes.grid.inside_m + sizes.grid.outside_m + sizes.grid.voxel_m
            points = round(_SKIN_M2 * thickness / sizes.grid.voxel_m**3)
        refiner = PoseRefiner(sizes.refiner, joints) if sizes.refiner else None
        residual = ResidualMotion(sizes, joints) if sizes.residual else None
        return {
            "canonical": parameter_count(canonical),
            "canonical_grid": points * (1 + sizes.grid.channels) if sizes.grid else 0,
            "weight_volume": parameter_count(SkeletonMotion(sizes, volume)),
            "residual": parameter_count(residual),
            "refiner": parameter_count(refiner),
        }


def _field_megabytes(sizes: FieldSizes, parameters: dict[str, int]) -> float:
    depth, height, width = sizes.volume
    volume = (JOINT_COUNT + 1) * depth * height * width
    learnt = sum(parameters[name] for name in ("canonical", "residual", "refiner"))
    stored = _BYTES["table"] * parameters["canonical_grid"] + _BYTES["learnt"] * learnt
    if sizes.baked:
        return (stored + _BYTES["baked"] * volume) / 1e6
    return (
        stored + _BYTES["learnt"] * parameters["weight_volume"] + _BYTES["prior"] * volume
    ) / 1e6


def _switched_on(sizes: FieldSizes) -> list[str]:
    """Networks and speed-ups that are not left out, in the words of the suffixes."""
    there = {
        "refiner": sizes.refiner,
        "weight-volume CNN": sizes.latent,
        "Gaussian-bone prior": sizes.bone_prior,
        "residual": sizes.residual,
        "exact inverse skinning": sizes.inverse_rounds,
        "cull": sizes.cull,
        "posed-grid": sizes.posed_grid,
        "occupancy": sizes.occupancy,
        "early-stop": sizes.early_stop,
        "grid": sizes.grid,
        "baked": sizes.baked,
        "fused": sizes.backend == "fused",
    }
    assert set(SPEED_UPS) <= set(there)
    return [name for name, value in there.items() if value]
