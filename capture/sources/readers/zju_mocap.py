"""ZJU-MoCap in its own layout: a person filmed by a ring of synchronised cameras.

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
    data_hash,
    moved_camera,
    our_intrinsics,
    picture_size,
    rest_skeleton,
    upright_world,
)
from capture.sources.readers.joints import joints_from_vertices
from capture.sources.readers.pickles import load_npy, numbers, strings, table
from capture.sources.readers.surface import with_surface
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE, Sequence

FRAMES_PER_SECOND = 30.0
"""The layout does not say; only the speed of playing depends on it."""
_PARAMETERS = ("new_params", "smpl_params", "params")
_VERTICES = {"new_params": "new_vertices", "smpl_params": "smpl_vertices", "params": "vertices"}
_TRAINED_SHARE = 0.8
"""Of the moments, from the first; the rest are unseen poses."""
_TEST_EVERY = 30
"""A moment in so many is seen by the other cameras, as the field's tables do."""
_JOINT_MOMENTS, _JOINT_VERTICES = 60, 1200
"""From how much the joints are found: enough, and a second's work."""


@dataclass(frozen=True, eq=False)
class _Poses:
    """What the parameter files say, in their world."""

    orient: Float[Array, "F 3"]
    place: Float[Array, "F 3"]
    """Th."""
    turn: Float[Array, "F 3 3"]
    """R(Rh), before the pelvis' own angles."""
    angles: Float[Array, "F 24 3"]
    """Row 0 as stored: what Rh leaves, nearly always nil."""


def open_zju_mocap(path: Path, training_camera: int = 0) -> Sequence:
    """The sequence in folder `path` (CoreView_387, my_377, ...); pictures are read one by one.

    One camera trains on the first 80 % of the moments. Every 30th moment is seen by all other
    cameras: as new views, and of the rest as unseen poses. The surface is our body model's, fitted
    to the joints; poses were estimated, so training may refine them.
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
    numbers_of = [_number(names[training_camera]) for names in pictures]
    folder = next((path / name for name in _PARAMETERS if (path / name).is_dir()), None)
    if folder is None:
        raise BrokenDataset(f"{path} must hold {', '.join(_PARAMETERS[:2])} or params; got none")
    poses = _read_poses(folder, numbers_of)
    joints = _rest_joints(path, folder.name, numbers_of, poses)
    skeleton = rest_skeleton(joints)
    pelvis = np.einsum("fij,j->fi", poses.turn, joints[0]) + poses.place
    times = np.arange(len(pictures)) / FRAMES_PER_SECOND
    motion, ours = upright_world(skeleton, poses.orient, pelvis, poses.angles[:, 1:], times)
    views = _Views(path, pictures, calibration, ours)
    cut = max(1, int(_TRAINED_SHARE * len(pictures)))
    others = [camera for camera in range(cameras) if camera != training_camera]
    train = views.frames(motion, [(moment, training_camera) for moment in range(cut)])
    tests = {}
    for split, moments in (
        (NOVEL_VIEW, range(0, cut, _TEST_EVERY)),
        (UNSEEN_POSE, range(cut, len(pictures), _TEST_EVERY)),
    ):
        shown = [(m, c) for m in moments for c in others if views.has(m, c)]
        if shown:
            tests[split] = views.frames(motion, shown)
    files = [path / "annots.npy", *(folder / f"{n}.npy" for n in numbers_of[:cut])]
    files += [file for shot in train.shots for file in (shot.picture, *shot.masks)]
    return Sequence(
        person=path.resolve().name,
        frames_per_second=FRAMES_PER_SECOND,
        body=with_surface(skeleton),
        train=train,
        data_hash=data_hash(path, [file for file in files if file.exists()]),
        motion=train.motion,
        test=tests,
    )


@dataclass(frozen=True, eq=False)
class _Views:
    """Pictures by moment and camera."""

    root: Path
    pictures: Series[list[str]]
    calibration: Series[tuple[Array, Array, Array]]
    """Of each camera: K, distortion, world -> camera [3 4] in m."""
    ours: Float[Array, "4 4"]

    def has(self, moment: int, camera: int) -> bool:
        """Whether that picture is there: some cameras failed."""
        return (self.root / self.pictures[moment][camera]).exists()

    def frames(self, motion: Motion, shown: Series[tuple[int, int]]) -> DatasetFrames:
        """Frames of (moment, camera) pairs."""
        first: dict[int, int] = {}
        for moment, camera in shown:
            first.setdefault(camera, moment)
        seen = {camera: self._camera(camera, moment) for camera, moment in first.items()}
        shots = []
        for moment, camera in shown:
            picture = self.root / self.pictures[moment][camera]
            intrinsics, distortion, _ = self.calibration[camera]
            lens = (intrinsics, distortion) if distortion.any() else None
            masks = self._masks(self.pictures[moment][camera])
            shots.append(DatasetFrame(picture, masks, seen[camera], labels=True, lens=lens))
        moments = sorted({moment for moment, _ in shown})
        return DatasetFrames(
            shots, _picked(motion, moments), [moments.index(moment) for moment, _ in shown]
        )

    def _camera(self, camera: int, moment: int) -> Camera:
        intrinsics, _, world_to_camera = self.calibration[camera]
        size = picture_size(self.root / self.pictures[moment][camera])
        return Camera(our_intrinsics(intrinsics), moved_camera(world_to_camera, self.ours), *size)

    def _masks(self, picture: str) -> tuple[Path, ...]:
        inside = Path(picture).with_suffix(".png")
        swapped = Path(*("mask" if part == "images" else part for part in inside.parts))
        tried = [self.root / "mask" / inside, self.root / "mask_cihp" / inside]
        tried += [self.root / swapped] if swapped != inside else []
        found = tuple(mask for mask in tried if mask.exists())
        if not found:
            raise BrokenDataset(f"{picture} must have a mask; got no {tried[-1]}")
        return found


def _picked(motion: Motion, moments: Series[int]) -> Motion:
    at = list(moments)
    return Motion(
        motion.times_s[at], motion.joint_angles[at], motion.root_translation[at],
        motion.confidence[at],
    )  # fmt: skip


def _pictures(held: Any) -> list[list[str]]:
    """Names of the pictures, a list a moment; none may leave the data set's folder."""
    if not isinstance(held, list | tuple) or not held:
        raise BrokenDataset("ims of annots.npy must be a list of moments; got none")
    moments = [strings(table(one, "ims", "ims")["ims"], "ims of a moment") for one in held]
    moments = [[name.replace("\\", "/") for name in names] for names in moments]
    for name in (name for names in moments for name in names):
        if name.startswith("/") or ".." in Path(name).parts:
            raise BrokenDataset(f"pictures must lie in the data set's folder; got {name!r}")
    return moments


def _calibration(held: Any) -> list[tuple[Array, Array, Array]]:
    cams = table(held, "cams of annots.npy", "K", "D", "R", "T")
    matrices = numbers(cams["K"], (None, 3, 3), "K of annots.npy")
    turns = numbers(cams["R"], (None, 3, 3), "R of annots.npy")
    count = len(matrices)
    places = numbers(cams["T"], (count, 3), "T of annots.npy") / 1000.0
    lenses = numbers(cams["D"], (count, 5), "D of annots.npy")
    if len(turns) != count:
        raise BrokenDataset(f"annots.npy must hold an R for each K; got {len(turns)} and {count}")
    return [
        (matrices[i], lenses[i], np.concatenate([turns[i], places[i][:, None]], axis=1))
        for i in range(count)
    ]


def _number(picture: str) -> int:
    """The number of a picture's parameters: 7 of `000007.jpg` and of `Camera (1)_0007_2019-...`."""
    name = Path(picture).stem
    found = re.search(r"\)_(\d+)_", name) or re.search(r"(\d+)$", name)
    if found is None:
        raise BrokenDataset(f"pictures must be numbered; got {picture!r}")
    return int(found.group(1))


def _read_poses(folder: Path, wanted: Series[int]) -> _Poses:
    orient, place, turn, angles = [], [], [], []
    for number in wanted:
        name = f"{folder.name}/{number}.npy"
        held = table(load_npy(folder / f"{number}.npy"), name, "poses", "Rh", "Th")
        pose = _angles(held["poses"], name)
        turned = axis_angle_to_matrix(numbers(held["Rh"], (3,), f"Rh of {name}"))
        turn.append(turned)
        orient.append(matrix_to_axis_angle(turned @ axis_angle_to_matrix(pose[0])))
        place.append(numbers(held["Th"], (3,), f"Th of {name}"))
        angles.append(pose)
    return _Poses(np.stack(orient), np.stack(place), np.stack(turn), np.stack(angles))


def _angles(held: Any, name: str) -> Float[Array, "24 3"]:
    """72 angles, or the 69 that EasyMocap writes without the pelvis' own."""
    flat = numbers(held, None, f"poses of {name}").ravel()
    flat = np.concatenate([np.zeros(3), flat]) if flat.size == 69 else flat
    return numbers(flat, (72,), f"poses of {name}").reshape(24, 3)


def _rest_joints(
    path: Path, parameters: str, wanted: Series[int], poses: _Poses
) -> Float[Array, "24 3"]:
    known = path / "lbs" / "joints.npy"
    if known.exists():
        return numbers(load_npy(known), (24, 3), "lbs/joints.npy")
    folder = path / _VERTICES[parameters]
    if not folder.is_dir():
        raise BrokenDataset(
            f"{path} must hold lbs/joints.npy or {folder.name}, to know the joints; got neither"
        )
    used = np.unique(np.linspace(0, len(wanted) - 1, _JOINT_MOMENTS).round().astype(int))
    world = np.stack(
        [
            numbers(load_npy(folder / f"{wanted[i]}.npy"), (None, 3), f"{folder.name}/{wanted[i]}")
            for i in used
        ]
    )
    world = world[:, :: max(1, world.shape[1] // _JOINT_VERTICES)]
    inside = np.einsum("fji,fvj->fvi", poses.turn[used], world - poses.place[used][:, None])
    return joints_from_vertices(inside, poses.angles[used])
