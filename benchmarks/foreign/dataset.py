"""Writes the test set: three folders in HumanNeRF's prepared layout, with exact poses.

train/          one camera, the person turns round once in a room with a key light
novel_view/     moments of the same turn from cameras that stand round the person
unseen_pose/    other gestures, from those cameras

python -m benchmarks.foreign.dataset OUT [SIZE] [FRAMES]
"""

from __future__ import annotations

import pickle
import shutil
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.foreign.figure import Figure, joint_frames, make_figure, posed
from benchmarks.foreign.moves import Move, dancing, rotation, turning
from benchmarks.foreign.picture import Lens, lens_on_ring, take

TRAIN, NOVEL_VIEW, UNSEEN_POSE = "train", "novel_view", "unseen_pose"
SIZE, FRAMES = 512, 80
NOVEL_VIEWS, UNSEEN_POSES = 24, 16
_RING_DEGREES = (45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0)


def write_dataset(folder: Path, size: int = SIZE, frames: int = FRAMES) -> None:
    """Write the three folders into `folder`, the same to the bit for the same sizes."""
    figure, turn = make_figure(), turning(frames)
    write_training_frames(folder / TRAIN, size, frames)
    moments = [turn[i * frames // NOVEL_VIEWS] for i in range(NOVEL_VIEWS)]
    for name, moves in ((NOVEL_VIEW, moments), (UNSEEN_POSE, dancing(UNSEEN_POSES))):
        _write(folder / name, figure, [(move, ring_lens(i, size)) for i, move in enumerate(moves)])


def write_training_frames(folder: Path, size: int, frames: int) -> None:
    """Write the folder that is trained on: one turn before a camera that stands still."""
    front = lens_on_ring(0.0, 1.0, 3.3, size)
    _write(folder, make_figure(), [(move, front) for move in turning(frames)])


def ring_lens(number: int, size: int) -> Lens:
    """The test camera of picture `number`: they take turns, at two heights."""
    degrees = _RING_DEGREES[3 * number % len(_RING_DEGREES)]
    return lens_on_ring(degrees, 1.0 if number % 2 else 1.5, 3.3, size)


def placed(figure: Figure, move: Move) -> tuple[np.ndarray, np.ndarray]:
    """Rotations against the parent [24, 3, 3] and the pelvis's place in the room [3]."""
    rotations = np.stack([rotation(angles) for angles in move.angles])
    rotations[0] = rotation(move.turn)
    return rotations, rotations[0] @ figure.joints[0] + move.place


def _write(folder: Path, figure: Figure, shots: list[tuple[Move, Lens]]) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    for kind in ("images", "masks"):
        (folder / kind).mkdir(parents=True)
    cameras: dict[str, Any] = {}
    meshes: dict[str, Any] = {}
    for number, (move, lens) in enumerate(shots):
        name = f"frame_{number:06d}"
        rotations, root = placed(figure, move)
        picture, alpha = take(figure, *posed(figure, rotations, root), lens)
        cv2.imwrite(str(folder / "images" / f"{name}.png"), picture[..., ::-1])
        cv2.imwrite(str(folder / "masks" / f"{name}.png"), np.stack([alpha] * 3, axis=-1))
        extrinsics = np.eye(4)
        extrinsics[:3, :3], extrinsics[:3, 3] = lens.turn, lens.shift
        cameras[name] = {
            "intrinsics": lens.matrix,
            "extrinsics": extrinsics,
            "distortions": np.zeros(5),
        }
        rotations[0] = np.eye(3)  # the layout's joints are in the body's axes
        meshes[name] = {
            "Rh": move.turn,
            "Th": move.place,
            "poses": move.angles.reshape(72),
            "joints": joint_frames(figure.joints, rotations, figure.joints[0])[1],
            "tpose_joints": figure.joints,
        }
    contents = {"cameras": cameras, "mesh_infos": meshes}
    for name, content in {**contents, "canonical_joints": {"joints": figure.joints}}.items():
        (folder / f"{name}.pkl").write_bytes(pickle.dumps(content, protocol=4))


if __name__ == "__main__":
    write_dataset(Path(sys.argv[1]), *(int(word) for word in sys.argv[2:]))
