"""What a renderer needs of a room, as bytes: models and environments once each, poses always."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

from renderer.model_files import load_model, save_model
from renderer.performer_model import PerformerModel
from scene.arrays import Array
from scene.environment import Environment
from scene.lighting import Lighting
from scene.motion import Pose
from scene.rotations import matrix_to_axis_angle, quaternion_to_matrix
from scene.skeleton import Skeleton
from services.live.packets import decode_pose

_FILE = "model.safetensors"
_LIGHT = ("harmonics", "key_direction", "key_colour")


def pack_model(model: PerformerModel) -> bytes:
    """The bytes of its file."""
    with tempfile.TemporaryDirectory(prefix="metanerf-model-") as folder:
        path = Path(folder) / _FILE
        save_model(model, path)
        return path.read_bytes()


def unpack_model(data: bytes) -> PerformerModel:
    """The model in a file of these bytes. Raises BrokenModel."""
    with tempfile.TemporaryDirectory(prefix="metanerf-model-") as folder:
        path = Path(folder) / _FILE
        path.write_bytes(data)
        return load_model(path)


def pack_environment(environment: Environment) -> bytes:
    """An environment, with its panorama and its light."""
    from safetensors.numpy import save

    arrays: dict[str, Array] = {}
    if environment.panorama is not None:
        arrays["panorama"] = environment.panorama
    if environment.lighting is not None:
        arrays |= {name: getattr(environment.lighting, name) for name in _LIGHT}
    about = {
        "name": environment.name,
        "horizon": environment.horizon,
        "zenith": environment.zenith,
        "floor": environment.floor,
        "shadow_strength": environment.shadow_strength,
    }
    head = json.dumps(about).encode()
    # safetensors takes arrays in C order alone
    kept = {name: array.copy(order="C") for name, array in arrays.items()}
    return len(head).to_bytes(4, "little") + head + save(kept)


def unpack_environment(data: bytes) -> Environment:
    """The environment of these bytes."""
    from safetensors.numpy import load

    end = 4 + int.from_bytes(data[:4], "little")
    about: dict[str, Any] = json.loads(data[4:end])
    arrays = load(data[end:])
    lighting = Lighting(*(arrays[name] for name in _LIGHT)) if _LIGHT[0] in arrays else None
    return Environment(
        about["name"],
        tuple(about["horizon"]),
        tuple(about["zenith"]),
        tuple(about["floor"]),
        about["shadow_strength"],
        arrays.get("panorama"),
        lighting,
    )


def pose_of(packet: bytes, skeleton: Skeleton) -> Pose:
    """The pose that a pose packet tells of a body of `skeleton` in the world of its model.

    Raises PacketError.
    """
    read = decode_pose(packet)
    return Pose(
        matrix_to_axis_angle(quaternion_to_matrix(read.rotations)),
        read.pelvis - skeleton.rest_joints[0],
        read.capture_time_ms / 1e3,
        read.expression,
    )
