"""ZJU-MoCap in its own layout: a person recorded by a ring of synchronised cameras.

    annots.npy     {"cams": {"K", "D", "R", "T"}, "ims": [{"ims": [picture of each camera]}]}
                   a camera a list entry; T in millimetres, x_camera = R x_world + T
    as first given           with the refined calibration      or
    Camera_B1/000000.jpg     images/00/000000.jpg              (named by annots.npy)
    mask/, mask_cihp/        mask/                             labels of body parts, 0 is background
    new_params/0.npy         smpl_params/0.npy                 params/0.npy
    new_vertices/0.npy       smpl_vertices/0.npy               vertices/0.npy

Parameters hold Rh, Th, poses [1 72] and shapes; vertices [6890 3] are in the world, m:
x_world = R(Rh) x_body + Th. Rest joints need SMPL, which may not be passed on: they are read from
lbs/joints.npy, which some copies have, or found from how the vertices move. Learnt from
https://github.com/zju3dv/neuralbody (lib/datasets/light_stage), .../animatable_nerf, .../EasyMocap
and https://github.com/skhu101/GauHuman (scene/dataset_readers.py).
"""

from __future__ import annotations

import re
from collections.abc import Sequence as Series
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
    upright_world,
)
from capture.sources.readers.joints import joints_from_vertices
from capture.sources.readers.pickles import load_npy, numbers, strings, table
from capture.sources.readers.surface import with_surface
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE, PoseTrust, Sequence

FRAMES_PER_SECOND = 30.0
"""Not stored in the layout; only the playback speed depends on it."""
_PARAMETERS = ("new_params", "smpl_params", "params")
_VERTICES = {"new_params": "new_vertices", "smpl_params": "smpl_vertices", "params": "vertices"}
_TRAINING_SHARE = 0.8
"""Share of the frames, from the first, that train; the rest are unseen poses."""
_TEST_EVERY = 30
"""Every 30th frame is evaluated from the other cameras, as in published tables."""
_JOINT_FRAMES, _JOINT_VERTICES = 60, 1200
"""Frames and vertices used to estimate the joints, which takes a second."""


@dataclass(frozen=True, eq=False)
class _SmplParameters:
    """SMPL parameters of all frames, in the data set's world."""

    global_orient: Float[Array, "F 3"]
    translation: Float[Array, "F 3"]
    """Th."""
    rotation: Float[Array, "F 3 3"]
    """R(Rh), before the pelvis' own angles."""
    joint_angles: Float[Array, "F 24 3"]
    """Row 0 as stored, beside Rh; nearly always zero."""


def open_zju_mocap(path: Path, training_camera: int = 0) -> Sequence:
    """The sequence in folder `path` (CoreView_387, my_377, ...); pictures are read one by one.

    One camera trains, on the first 80 % of the frames. Every 30th frame of the other cameras is for
    evaluation: novel views of these, unseen poses of the rest. The surface is that of MetaNeRF's
    body model, fitted to the joints; poses were estimated, so training may refine them.
    Raises BrokenDataset naming the file and the rule it breaks, also for code in annots.npy.
    """
    annots = table(load_npy(path / "annots.npy"), "annots.npy", "cams", "ims")
    pictures = _pictures(annots["ims"])
    calibration = _calibration(annots["cams"])
    cameras = min(len(calibration), *(len(names) for names in pictures))
    if not 0 <= training_camera < cameras:
        raise BrokenDataset(
            f"training_camera must be one of the {cameras} cameras; got {training_camera}"
        )
    frame_numbers = [_frame_number(names[training_camera]) for names in pictures]
    folder = next((path / name for name in _PARAMETERS if (path / name).is_dir()), None)
    if folder is None:
        raise BrokenDataset(f"{path} must hold {', '.join(_PARAMETERS[:2])} or params; got none")
    poses = _read_poses(folder, frame_numbers)
    joints = _rest_joints(path, folder.name, frame_numbers, poses)
    skeleton = rest_skeleton(joints)
    pelvis = np.einsum("fij,j->fi", poses.rotation, joints[0]) + poses.translation
    times = np.arange(len(pictures)) / FRAMES_PER_SECOND
    motion, dataset_to_world = upright_world(
        skeleton, poses.global_orient, pelvis, poses.joint_angles[:, 1:], times
    )
    multi_view = _MultiViewFrames(path, pictures, calibration, dataset_to_world)
    cut = max(1, int(_TRAINING_SHARE * len(pictures)))
    others = [camera for camera in range(cameras) if camera != training_camera]
    train = multi_view.frames(motion, [(index, training_camera) for index in range(cut)])
    tests = {}
    for split, indices in (
        (NOVEL_VIEW, range(0, cut, _TEST_EVERY)),
        (UNSEEN_POSE, range(cut, len(pictures), _TEST_EVERY)),
    ):
        test_views = [(m, c) for m in indices for c in others if multi_view.has(m, c)]
        if test_views:
            tests[split] = multi_view.frames(motion, test_views)
    files = [path / "annots.npy", *(folder / f"{n}.npy" for n in frame_numbers[:cut])]
    files += [file for shot in train.frames for file in (shot.picture, *shot.masks)]
    return Sequence(
        person=path.resolve().name,
        frames_per_second=FRAMES_PER_SECOND,
        body=with_surface(skeleton),
        train=train,
        data_hash=data_hash(path, [file for file in files if file.exists()]),
        motion=train.motion,
        test=tests,
        pose_trust=PoseTrust.GIVEN,
    )


@dataclass(frozen=True, eq=False)
class _MultiViewFrames:
    """Pictures by frame and camera."""

    root: Path
    pictures: Series[list[str]]
    calibration: Series[tuple[Array, Array, Array]]
    """Of each camera: K, distortion, world -> camera [3 4] in m."""
    dataset_to_world: Float[Array, "4 4"]

    def has(self, index: int, camera: int) -> bool:
        """Whether that picture exists: some cameras failed."""
        return (self.root / self.pictures[index][camera]).exists()

    def frames(self, motion: Motion, views: Series[tuple[int, int]]) -> DatasetFrames:
        """Frames of (frame index, camera) pairs."""
        first_index: dict[int, int] = {}
        for index, camera in views:
            first_index.setdefault(camera, index)
        cameras = {camera: self._camera(camera, index) for camera, index in first_index.items()}
        frames = []
        for index, camera in views:
            picture = self.root / self.pictures[index][camera]
            intrinsics, distortion, _ = self.calibration[camera]
            lens = (intrinsics, distortion) if distortion.any() else None
            masks = self._masks(self.pictures[index][camera])
            frames.append(DatasetFrame(picture, masks, cameras[camera], labels=True, lens=lens))
        indices = sorted({index for index, _ in views})
        return DatasetFrames(
            frames, _select_poses(motion, indices), [indices.index(index) for index, _ in views]
        )

    def _camera(self, camera: int, index: int) -> Camera:
        intrinsics, _, world_to_camera = self.calibration[camera]
        size = picture_size(self.root / self.pictures[index][camera])
        return Camera(
            to_half_pixel_centres(intrinsics),
            camera_in_world(world_to_camera, self.dataset_to_world),
            *size,
        )

    def _masks(self, picture: str) -> tuple[Path, ...]:
        relative = Path(picture).with_suffix(".png")
        mask_folder = Path(*("mask" if part == "images" else part for part in relative.parts))
        candidates = [self.root / "mask" / relative, self.root / "mask_cihp" / relative]
        candidates += [self.root / mask_folder] if mask_folder != relative else []
        found = tuple(mask for mask in candidates if mask.exists())
        if not found:
            raise BrokenDataset(f"{picture} must have a mask; got no {candidates[-1]}")
        return found


def _select_poses(motion: Motion, indices: Series[int]) -> Motion:
    at = list(indices)
    return Motion(
        motion.times_s[at],
        motion.joint_angles[at],
        motion.root_translation[at],
        motion.confidence[at],
    )


def _pictures(stored: Any) -> list[list[str]]:
    """Names of the pictures of each frame; none may leave the data set's folder."""
    if not isinstance(stored, list | tuple) or not stored:
        raise BrokenDataset("ims of annots.npy must be a list of moments; got none")
    pictures = [strings(table(one, "ims", "ims")["ims"], "ims of a moment") for one in stored]
    pictures = [[name.replace("\\", "/") for name in names] for names in pictures]
    for name in (name for names in pictures for name in names):
        if name.startswith("/") or ".." in Path(name).parts:
            raise BrokenDataset(f"pictures must lie in the data set's folder; got {name!r}")
    return pictures


def _calibration(stored: Any) -> list[tuple[Array, Array, Array]]:
    cameras = table(stored, "cams of annots.npy", "K", "D", "R", "T")
    matrices = numbers(cameras["K"], (None, 3, 3), "K of annots.npy")
    rotations = numbers(cameras["R"], (None, 3, 3), "R of annots.npy")
    count = len(matrices)
    translations = numbers(cameras["T"], (count, 3), "T of annots.npy") / 1000.0
    distortions = numbers(cameras["D"], (count, 5), "D of annots.npy")
    if len(rotations) != count:
        raise BrokenDataset(
            f"annots.npy must hold an R for each K; got {len(rotations)} and {count}"
        )
    return [
        (
            matrices[i],
            distortions[i],
            np.concatenate([rotations[i], translations[i][:, None]], axis=1),
        )
        for i in range(count)
    ]


def _frame_number(picture: str) -> int:
    """The frame number of a picture, which names its parameters: 7 of `000007.jpg` and of `Camera
    (1)_0007_2019-...`."""
    name = Path(picture).stem
    found = re.search(r"\)_(\d+)_", name) or re.search(r"(\d+)$", name)
    if found is None:
        raise BrokenDataset(f"pictures must be numbered; got {picture!r}")
    return int(found.group(1))


def _read_poses(folder: Path, frame_numbers: Series[int]) -> _SmplParameters:
    global_orient, translation, rotation, joint_angles = [], [], [], []
    for number in frame_numbers:
        name = f"{folder.name}/{number}.npy"
        stored = table(load_npy(folder / f"{number}.npy"), name, "poses", "Rh", "Th")
        pose = _angles(stored["poses"], name)
        frame_rotation = axis_angle_to_matrix(numbers(stored["Rh"], (3,), f"Rh of {name}"))
        rotation.append(frame_rotation)
        global_orient.append(matrix_to_axis_angle(frame_rotation @ axis_angle_to_matrix(pose[0])))
        translation.append(numbers(stored["Th"], (3,), f"Th of {name}"))
        joint_angles.append(pose)
    return _SmplParameters(
        np.stack(global_orient), np.stack(translation), np.stack(rotation), np.stack(joint_angles)
    )


def _angles(stored: Any, name: str) -> Float[Array, "24 3"]:
    """72 angles, or the 69 that EasyMocap writes without the pelvis' own."""
    flat = numbers(stored, None, f"poses of {name}").ravel()
    flat = np.concatenate([np.zeros(3), flat]) if flat.size == 69 else flat
    return numbers(flat, (72,), f"poses of {name}").reshape(24, 3)


def _rest_joints(
    path: Path, parameters: str, frame_numbers: Series[int], poses: _SmplParameters
) -> Float[Array, "24 3"]:
    known = path / "lbs" / "joints.npy"
    if known.exists():
        return numbers(load_npy(known), (24, 3), "lbs/joints.npy")
    folder = path / _VERTICES[parameters]
    if not folder.is_dir():
        raise BrokenDataset(
            f"{path} must hold lbs/joints.npy or {folder.name}, to know the joints; got neither"
        )
    chosen = np.unique(np.linspace(0, len(frame_numbers) - 1, _JOINT_FRAMES).round().astype(int))
    world = np.stack(
        [
            numbers(
                load_npy(folder / f"{frame_numbers[i]}.npy"),
                (None, 3),
                f"{folder.name}/{frame_numbers[i]}",
            )
            for i in chosen
        ]
    )
    world = world[:, :: max(1, world.shape[1] // _JOINT_VERTICES)]
    in_body = np.einsum(
        "fji,fvj->fvi", poses.rotation[chosen], world - poses.translation[chosen][:, None]
    )
    return joints_from_vertices(in_body, poses.joint_angles[chosen])
