"""Model files: one .safetensors file with the weights, and about them in its header.

The header is JSON in safetensors' metadata: format version, kind, preset, data_hash, metrics.
Every file also holds the person's rest joints and the motion of their clip.
"""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from renderer.errors import BrokenModel
from renderer.performer_model import PerformerModel
from scene.arrays import Array
from scene.expression import values_of_any_version
from scene.motion import Motion
from scene.skeleton import Skeleton

VERSION = 1
_MOTION = ("times_s", "joint_angles", "root_translation", "confidence")
_EXPRESSIONS = "motion.expressions"
_TOLD = {"kind": str, "preset": str, "data_hash": str, "metrics": dict}
_WRONG = (
    KeyError,
    IndexError,
    AttributeError,
    ValueError,
    TypeError,
    OverflowError,
    RuntimeError,
    zlib.error,
)
"""What parts of a file that are missing, or are others than ours, lead to."""


def save_model(model: PerformerModel, path: Path) -> None:
    """Write `model` to `path`, whole or not at all."""
    from safetensors.numpy import save_file

    tensors = model.tensors()
    tensors |= {"rest_joints": model.skeleton.rest_joints.astype(np.float32)}
    tensors |= {f"motion.{k}": getattr(model.motion, k).astype(np.float32) for k in _MOTION}
    if model.motion.expressions.any():
        tensors[_EXPRESSIONS] = model.motion.expressions.astype(np.float32)
    # float32 seconds of a long clip may collide: times stay exact
    tensors["motion.times_s"] = model.motion.times_s
    about = {
        "version": VERSION,
        "kind": model.kind,
        "preset": model.preset,
        "data_hash": model.data_hash,
        "metrics": model.metrics,
        **model.header(),
    }
    part = path.with_name(path.name + ".part")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        save_file(
            {k: np.ascontiguousarray(v) for k, v in tensors.items()},
            str(part),
            metadata={"metanerf": json.dumps(about)},
        )
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def load_model(path: Path) -> PerformerModel:
    """The model in `path`. Raises BrokenModel for anything that is none of ours."""
    tensors, about = _read(path)
    try:
        moved = {k: tensors.pop(f"motion.{k}").astype(np.float64) for k in _MOTION}
        if _EXPRESSIONS in tensors:
            stored = tensors.pop(_EXPRESSIONS).astype(np.float64)
            moved["expressions"] = values_of_any_version(stored)
        motion = Motion(**moved)
        skeleton = Skeleton(tensors.pop("rest_joints").astype(np.float64))
        return _unpack(tensors, about, skeleton, motion)
    except _WRONG as error:
        raise BrokenModel(f"{path.name} must hold a whole model; got {error!r}") from error


def _read(path: Path) -> tuple[dict[str, Array], dict[str, Any]]:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(str(path), framework="numpy") as stored:
            about = json.loads((stored.metadata() or {}).get("metanerf", "{}"))
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    # RecursionError: JSON nested without end; TypeError: numbers that NumPy does not have
    except (OSError, SafetensorError, ValueError, TypeError, RecursionError) as error:
        raise BrokenModel(
            f"{path} must be a model file (.safetensors); got {error}; train it again"
        ) from error
    version = about.get("version") if isinstance(about, dict) else None
    if version != VERSION:
        raise BrokenModel(
            f"{path.name} must be a model of version {VERSION}; got {version!r}; train it again"
        )
    for name, kind in _TOLD.items():
        if not isinstance(about.get(name), kind):
            raise BrokenModel(
                f"{path.name} must tell its {name} as {kind.__name__}; got {about.get(name)!r:.80}"
            )
    return tensors, about


def _unpack(
    tensors: dict[str, Array], about: dict[str, Any], skeleton: Skeleton, motion: Motion
) -> PerformerModel:
    if about["kind"] == "splats":
        from renderer.splats.model import SplatModel

        return SplatModel.from_tensors(tensors, about, skeleton, motion)
    from renderer.field.model import FieldModel

    return FieldModel.from_tensors(tensors, about, skeleton, motion)
