"""Folders as the public tools write them, filled with studio performers."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from capture.studio.motions import gesture_motion
from capture.studio.performer import StudioPerformer, make_performer, render_performer
from scene import Camera, Motion, orbit_camera
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle

SIZE = 96
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Our world -> one whose z is up, as ZJU-MoCap's."""
Y_DOWN = np.diag([1.0, -1.0, -1.0])
"""Our world -> one whose y is down, as a camera's own."""
BACKGROUND = 0.35


@dataclass
class Truth:
    """A performer filmed by a ring of cameras; `world` is how the data set sees our world."""

    performer: StudioPerformer = field(default_factory=lambda: make_performer(2))
    motion: Motion = field(default_factory=lambda: gesture_motion(40, 10.0))
    cameras: int = 3
    world: np.ndarray = field(default_factory=lambda: Z_UP)
    shift: np.ndarray = field(default_factory=lambda: np.array([0.3, -0.7, 0.9]))
    filmed: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    def camera(self, index: int) -> Camera:
        """Camera `index` of the ring, in our world."""
        azimuth = 2.0 * np.pi * index / self.cameras
        return orbit_camera(np.array([0.0, 0.9, 0.0]), 4.0, azimuth, 0.1, SIZE, SIZE, 0.6)

    def their_extrinsics(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """R [3 3] and t [3], m, of their world."""
        ours = self.camera(index)
        turn = ours.rotation @ self.world.T
        return turn, ours.translation - turn @ self.shift

    def their_intrinsics(self, index: int) -> np.ndarray:
        """K of pixels centred on integers."""
        return self.camera(index).intrinsics - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])

    def parameters(self, moment: int) -> dict[str, np.ndarray]:
        """Rh, Th, poses and shapes of their world."""
        pose, rest = self.motion.pose(moment), self.performer.body.skeleton.rest_joints
        turn = self.world @ axis_angle_to_matrix(pose.joint_angles[0])
        pelvis = self.world @ (rest[0] + pose.root_translation) + self.shift
        angles = pose.joint_angles.copy()
        angles[0] = 0.0
        return {
            "poses": angles.reshape(1, 72),
            "Rh": matrix_to_axis_angle(turn)[None],
            "Th": (pelvis - turn @ rest[0])[None],
            "shapes": np.zeros((1, 10)),
        }

    def vertices(self, moment: int) -> np.ndarray:
        """[V 3] of their world."""
        ours = self.performer.body.posed_vertices(self.motion.pose(moment))
        return (ours @ self.world.T + self.shift).astype(np.float32)

    def picture(self, moment: int, camera: int) -> tuple[np.ndarray, np.ndarray]:
        """BGR in front of a grey wall, and the alpha, both 8 bit."""
        if (moment, camera) not in self.filmed:
            pose = self.motion.pose(moment)
            image, alpha = render_performer(self.performer, pose, self.camera(camera), "plain")
            seen = (image + BACKGROUND * (1.0 - alpha[..., None]))[..., ::-1]
            pixels, mask = ((255.0 * level + 0.5).astype(np.uint8) for level in (seen, alpha))
            self.filmed[moment, camera] = (pixels, mask)
        return self.filmed[moment, camera]

    def joint_pixels(self, moment: int, camera: int) -> np.ndarray:
        """Where the joints are seen, px, by our convention."""
        pose = self.motion.pose(moment)
        joints = self.performer.body.skeleton.joint_transforms(
            pose.joint_angles, pose.root_translation
        )
        return self.camera(camera).project(joints[:, :3, 3])[0]


def write_zju(
    path: Path,
    truth: Truth,
    *,
    refined: bool = False,
    joints: bool = True,
    numbered_from_one: bool = False,
    distortion: tuple[float, ...] = (0.0,) * 5,
) -> Path:
    """ZJU-MoCap as first given, or `refined`; `numbered_from_one` as its subjects 313 and 315."""
    path.mkdir(parents=True)
    parameters = "smpl_params" if refined else "new_params"
    vertices = "smpl_vertices" if refined else "new_vertices"
    count = len(truth.motion)
    for folder in (parameters, vertices):
        (path / folder).mkdir()
    names = [
        [_zju_name(camera, moment, refined, numbered_from_one) for camera in range(truth.cameras)]
        for moment in range(count)
    ]
    for moment in range(count):
        number = moment + 1 if numbered_from_one else moment
        np.save(path / parameters / f"{number}.npy", truth.parameters(moment))  # type: ignore
        np.save(path / vertices / f"{number}.npy", truth.vertices(moment))
        for camera, name in enumerate(names[moment]):
            _zju_picture(path, name, refined, *truth.picture(moment, camera))
    if joints:
        (path / "lbs").mkdir()
        np.save(path / "lbs" / "joints.npy", truth.performer.body.skeleton.rest_joints)
    extrinsics = [truth.their_extrinsics(camera) for camera in range(truth.cameras)]
    annots = {
        "cams": {
            "K": [truth.their_intrinsics(camera) for camera in range(truth.cameras)],
            "D": [np.array(distortion)[:, None] for _ in range(truth.cameras)],
            "R": [turn for turn, _ in extrinsics],
            "T": [1000.0 * place[:, None] for _, place in extrinsics],
        },
        "ims": [{"ims": list(one), "kpts2d": np.zeros((3, 25, 3))} for one in names],
    }
    np.save(path / "annots.npy", annots)  # type: ignore[arg-type]  # as their tools do
    return path


def _zju_name(camera: int, moment: int, refined: bool, numbered_from_one: bool) -> str:
    if numbered_from_one:
        clock = f"2019-08-23_16-08-50.{moment:03d}"
        return f"Camera ({camera + 1})/Camera ({camera + 1})_{moment + 1:04d}_{clock}.jpg"
    if refined:
        return f"images/{camera:02d}/{moment:06d}.jpg"
    return f"Camera_B{camera + 1}/{moment:06d}.jpg"


def _zju_picture(path: Path, name: str, refined: bool, pixels: np.ndarray, alpha: Any) -> None:
    (path / name).parent.mkdir(parents=True, exist_ok=True)
    fine = cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444
    cv2.imwrite(str(path / name), pixels, [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, fine])
    person = (alpha > 127).astype(np.uint8)
    if refined:
        masks = {path / name.replace("images", "mask"): person}
    else:  # two opinions, each of a half; labels of body parts are small numbers
        top, bottom = 3 * person, 7 * person
        top[SIZE // 2 :], bottom[: SIZE // 2] = 0, 0
        masks = {path / "mask" / name: top, path / "mask_cihp" / name: bottom}
    for mask, labels in masks.items():
        mask.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(mask.with_suffix(".png")), labels)


def write_humannerf_of_a_video(path: Path, truth: Truth) -> Path:
    """HumanNeRF's layout as its tool for videos writes it: camera's world, pelvis at the origin."""
    rest = truth.performer.body.skeleton.rest_joints
    cameras: dict[str, Any] = {}
    meshes: dict[str, Any] = {}
    for kind in ("images", "masks"):
        (path / kind).mkdir(parents=True)
    for moment in range(len(truth.motion)):
        name = f"{moment:06d}"
        given = truth.parameters(moment)
        turn, place = truth.their_extrinsics(0)
        extrinsics = np.eye(4, dtype=np.float32)
        extrinsics[:3, :3], extrinsics[:3, 3] = turn, place
        intrinsics = truth.their_intrinsics(0).astype(np.float32)
        cameras[name] = {"intrinsics": intrinsics, "extrinsics": extrinsics}
        rotation = axis_angle_to_matrix(given["Rh"][0])
        meshes[name] = {
            "Rh": given["Rh"][0].astype(np.float32),
            "Th": given["Th"][0] + rotation @ rest[0],
            "poses": given["poses"][0].astype(np.float32),
            "joints": rest - rest[0],
            "tpose_joints": rest - rest[0],
        }
        pixels, alpha = truth.picture(moment, 0)
        cv2.imwrite(str(path / "images" / f"{name}.png"), pixels)
        cv2.imwrite(str(path / "masks" / f"{name}.png"), np.stack([alpha] * 3, axis=-1))
    held = {"cameras": cameras, "mesh_infos": meshes, "canonical_joints": {"joints": rest - 0.1}}
    for name, value in held.items():
        (path / f"{name}.pkl").write_bytes(pickle.dumps(value, protocol=3))
    return path


def seen_joints(source: Any, body: Any, index: int) -> np.ndarray:
    """Where a reader's frame `index` puts the joints, px."""
    pose = source.pose(index)
    joints = body.skeleton.joint_transforms(pose.joint_angles, pose.root_translation)
    return source.camera(index).project(joints[:, :3, 3])[0]
