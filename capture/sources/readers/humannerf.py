"""HumanNeRF's prepared layout, read and written: what its tools make of ZJU-MoCap and of videos.

    cameras.pkl           frame -> intrinsics [3 3], extrinsics [4 4] (world -> camera, m),
                          distortions [5] (may be absent)
    mesh_infos.pkl        frame -> Rh [3], Th [3], poses [72], joints [24 3], tpose_joints [24 3]
    canonical_joints.pkl  joints [24 3]
    images/<frame>.png    with its background        masks/<frame>.png   three channels, 0 to 255

x_world = R(Rh) x_body + Th, and the pelvis of the body stands at tpose_joints[0]. Learnt from
https://github.com/chungyiweng/humannerf (tools/prepare_zju_mocap, core/data/human_nerf/train.py).
"""

from __future__ import annotations

import pickle
import shutil
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from capture.errors import BrokenDataset
from capture.sources.readers.frames import (
    DatasetFrame,
    DatasetFrames,
    camera_in_world,
    data_hash,
    picture_size,
    rest_skeleton,
    to_half_pixel_centres,
    to_integer_pixel_centres,
    upright_world,
)
from capture.sources.readers.pickles import load_pickle, numbers, table
from capture.sources.readers.surface import with_surface
from scene.arrays import Array
from scene.camera import Camera
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import PoseTrust, Sequence

PICKLES = ("cameras.pkl", "mesh_infos.pkl", "canonical_joints.pkl")
_PICTURES = (".png", ".jpg", ".jpeg")
FRAMES_PER_SECOND = 30.0
"""Not stored in the layout; only the playback speed depends on it."""


def open_humannerf(path: Path) -> Sequence:
    """The sequence in folder `path`; pictures are read later, one by one.

    The surface is that of MetaNeRF's body model, fitted to the joints; poses were estimated, so
    training may refine them. Raises BrokenDataset naming the file and the rule it breaks, also for
    a pickle with code in it."""
    cameras, meshes, canonical = (load_pickle(path / name) for name in PICKLES)
    joints = numbers(table(canonical, PICKLES[2], "joints")["joints"], (24, 3), "joints")
    skeleton = rest_skeleton(joints)
    files = [file for ending in _PICTURES for file in (path / "images").glob(f"*{ending}")]
    names = sorted({file.stem for file in files})
    if not names:
        raise BrokenDataset(f"{path / 'images'} must hold .png or .jpg pictures; got none")
    table(cameras, PICKLES[0], *names)
    table(meshes, PICKLES[1], *names)
    poses = [_pose(meshes[name], name) for name in names]
    global_orient, pelvis, body_pose = (np.stack([pose[i] for pose in poses]) for i in range(3))
    times = np.arange(len(names)) / FRAMES_PER_SECOND
    motion, dataset_to_world = upright_world(skeleton, global_orient, pelvis, body_pose, times)
    size = picture_size(_picture(path / "images", names[0]))
    frames = [_frame_of(path, name, cameras[name], size, dataset_to_world) for name in names]
    files = [path / name for name in PICKLES]
    files += [file for frame in frames for file in (frame.picture, *frame.masks) if file.exists()]
    return Sequence(
        person=path.resolve().name,
        frames_per_second=FRAMES_PER_SECOND,
        body=with_surface(skeleton),
        train=DatasetFrames(frames, motion, range(len(frames))),
        data_hash=data_hash(path, files),
        motion=motion,
        pose_trust=PoseTrust.GIVEN,
    )


def write_humannerf(sequence: Sequence, path: Path) -> None:
    """Write the training frames of `sequence`. The folder appears at `path` whole, or not at all.

    Colours are divided by the soft mask, since HumanNeRF's code multiplies by it again.
    Raises BrokenDataset if `path` exists, or for a lens with distortion.
    """
    if path.exists():
        raise BrokenDataset(f"out must not exist yet; got {path}; remove it or choose another")
    path.parent.mkdir(parents=True, exist_ok=True)
    building = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    try:
        cameras: dict[str, Any] = {}
        meshes: dict[str, Any] = {}
        for kind in ("images", "masks"):
            (building / kind).mkdir()
        for index in range(len(sequence.train)):
            name = f"frame_{index:06d}"
            cameras[name] = _camera_of(sequence.train.camera(index))
            meshes[name] = _mesh_of(sequence, index)
            _write_pictures(building, name, sequence.train.image(index), sequence.train.mask(index))
        rest = sequence.body.skeleton.rest_joints.astype(np.float32)
        for name, contents in zip(PICKLES, (cameras, meshes, {"joints": rest}), strict=True):
            (building / name).write_bytes(pickle.dumps(contents, protocol=4))
        building.chmod(0o755)
        building.rename(path)
    except BaseException:
        shutil.rmtree(building, ignore_errors=True)
        raise


def _pose(mesh: Any, name: str) -> tuple[Array, Array, Array]:
    """Global orientation [3], position of the pelvis [3], the other joints' angles [23 3]."""
    mesh = table(mesh, name, "Rh", "Th", "poses", "tpose_joints")
    poses = numbers(mesh["poses"], (72,), f"poses of {name}").reshape(24, 3)
    rest = numbers(mesh["tpose_joints"], (24, 3), f"tpose_joints of {name}")
    rotation = axis_angle_to_matrix(numbers(mesh["Rh"], (3,), f"Rh of {name}"))
    translation = numbers(mesh["Th"], (3,), f"Th of {name}")
    global_orient = matrix_to_axis_angle(rotation @ axis_angle_to_matrix(poses[0]))
    return global_orient, rotation @ rest[0] + translation, poses[1:]


def _frame_of(
    path: Path, name: str, stored: Any, size: tuple[int, int], dataset_to_world: Array
) -> DatasetFrame:
    stored = table(stored, name, "intrinsics", "extrinsics")
    intrinsics = numbers(stored["intrinsics"], (3, 3), f"intrinsics of {name}")
    extrinsics = numbers(stored["extrinsics"], (4, 4), f"extrinsics of {name}")
    lens = None
    if "distortions" in stored:
        distortion = numbers(stored["distortions"], (5,), f"distortions of {name}")
        lens = (intrinsics, distortion) if distortion.any() else None
    camera = Camera(
        to_half_pixel_centres(intrinsics), camera_in_world(extrinsics[:3], dataset_to_world), *size
    )
    picture, mask = (_picture(path / kind, name) for kind in ("images", "masks"))
    return DatasetFrame(picture, (mask,), camera, lens=lens)


def _picture(folder: Path, name: str) -> Path:
    """The file of that name in any format; its .png path where there is none."""
    files = [folder / f"{name}{ending}" for ending in _PICTURES]
    return next((file for file in files if file.exists()), files[0])


def _camera_of(camera: Camera) -> dict[str, Array]:
    if camera.distortion is not None:
        raise BrokenDataset("cameras must be pinholes to be written; got one with distortion")
    extrinsics = np.eye(4)
    extrinsics[:3] = camera.world_to_camera
    return {
        "intrinsics": to_integer_pixel_centres(camera.intrinsics).astype(np.float32),
        "extrinsics": extrinsics,
        "distortions": np.zeros(5, np.float32),
    }


def _mesh_of(sequence: Sequence, index: int) -> dict[str, Array]:
    pose, skeleton = sequence.train.pose(index), sequence.body.skeleton
    rest, angles = skeleton.rest_joints, pose.joint_angles.copy()
    global_orient = angles[0].copy()
    angles[0] = 0.0
    joints = skeleton.joint_transforms(angles, np.zeros(3))[:, :3, 3]
    translation = rest[0] + pose.root_translation - axis_angle_to_matrix(global_orient) @ rest[0]
    return {
        "Rh": global_orient.astype(np.float32),
        "Th": translation.astype(np.float32),
        "poses": angles.reshape(72).astype(np.float32),
        "joints": joints.astype(np.float32),
        "tpose_joints": rest.astype(np.float32),
    }


def _write_pictures(folder: Path, name: str, image: Array, mask: Array) -> None:
    colour = image / np.maximum(mask, 1e-3)[..., None]
    for kind, values in (("images", colour[..., ::-1]), ("masks", np.stack([mask] * 3, axis=-1))):
        pixels = (np.clip(values, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
        data = cv2.imencode(".png", pixels)[1]
        (folder / kind / f"{name}.png").write_bytes(data.tobytes())
