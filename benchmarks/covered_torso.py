"""The torso where hands were in front of it: as well learnt as the rest of it?

Lifelike performers film themselves from the waist up, both hands before the chest all the while, so
that no frame shows all of it; 60 frames, exact poses. Then they are drawn with their hands away.
Each pixel of the torso knows in how many frames of the clip a hand or forearm hid its place on the
surface. Of what hands hid in a fifth of them and more, and of what they hid in a twentieth at most,
LPIPS is that of the truth with that part alone taken from the model, over the part's share of the
picture. Once so, and once from pixels alone: filmed before a room and captured, each test pose
aligned with its own picture.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.optimize import least_squares

from benchmarks.real.filmed import whole_camera
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import Clock, clock_named
from capture.pipeline import CaptureOptions, capture_clip
from capture.sources.clips import read_clip
from capture.storage import open_sequence, write_sequence
from capture.studio.footage import Footage, FootageWriter
from capture.studio.lifelike.performer import DressedPerformer, make_lifelike_performer
from capture.studio.motions import turntable_motion
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from renderer.evaluation.lpips import Lpips
from renderer.evaluation.pose_alignment import Aligner
from renderer.training import train
from scene.arrays import Array, Bool, Float, Int
from scene.camera import Camera, orbit_camera
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import Frame, PoseTrust, Sequence
from scene.skeleton import JOINT_NAMES, Skeleton

PERFORMERS = ("hazel", "jasper", "moss")
POSES = ("exact", "captured")
MUST, AIM = 0.03, 0.01
BUDGET_S = 60.0
FRAMES, RATE_HZ, TEST_FRAMES, SIZE_PX = 60, 10.0, 8, 384
COVERED_SHARE, REST_SHARE = 0.2, 0.05
"""Of the frames: what hands hid oftener counts as covered, what they hid less as the rest."""
_TARGET, _DISTANCE_M, _FIELD_OF_VIEW_RAD = (0.0, 1.25, 0.0), 1.6, 0.6
_BEFORE_CHEST_M, _REACH_M, _UP_M = 0.22, 0.13, 0.12
_TURN_RAD = 0.15
_ROOM_SEED = 3
_TORSO = ("pelvis", "spine1", "spine2", "spine3", "left_collar", "right_collar")
_COVERING = tuple(
    f"{side}_{part}" for side in ("left", "right") for part in ("elbow", "wrist", "hand")
)
_TORSO_JOINTS, _COVERING_JOINTS = (
    [JOINT_NAMES.index(name) for name in names] for names in (_TORSO, _COVERING)
)


@dataclass(frozen=True, eq=False)
class Covered:
    """A performer before the camera, and which of their triangles are seen."""

    performer: DressedPerformer
    camera: Camera

    def triangles(self, pose: Pose) -> Int[Array, "H W"]:
        """The nearest triangle of each pixel; -1 where nobody is."""
        from capture.studio.mesh_kernels import rasterise

        size = (self.camera.height, self.camera.width)
        triangle = np.empty(size, np.int32)
        barycentric, nearest = np.empty((*size, 3), np.float32), np.empty(size, np.float32)
        pixels, depth = self.camera.project(self.performer.posed_vertices(pose))
        everything = np.full(size, np.inf, np.float32)
        faces = self.performer.surface.faces
        rasterise(pixels, depth, faces, triangle, barycentric, nearest, everything)
        return triangle

    def hidden_shares(self, motion: Motion) -> Float[Array, "T"]:
        """In how many of the motion's poses, as a share of them, hands or forearms are in front of
        each triangle."""
        faces, joints = self.performer.surface.faces, self.joints
        hidden = np.zeros(len(faces))
        for number in range(len(motion)):
            pose = motion.pose(number)
            seen = self.triangles(pose)
            centres = self.performer.posed_vertices(pose)[faces].mean(axis=1)
            at = np.floor(self.camera.project(centres)[0]).astype(int)
            inside = ((at >= 0) & (at < seen.shape[::-1])).all(axis=1)
            x, y = np.clip(at, 0, np.array(seen.shape[::-1]) - 1).T
            front = seen[y, x]
            hidden += inside & (front >= 0) & np.isin(joints[front], _COVERING_JOINTS)
        return hidden / len(motion)

    @property
    def joints(self) -> Int[Array, "T"]:
        """Of each triangle: the joint that moves it most."""
        weights = self.performer.surface.body.blend_weights
        assert weights is not None
        return weights[self.performer.surface.faces].sum(axis=1).argmax(axis=1)


@dataclass(frozen=True)
class PerformersAndNetworks:
    """Where what does not ship with the package lies: performers, and networks."""

    assets: Path
    backbone: Path
    pose: Path
    face: Path
    hand: Path


def run(
    writer: FigureWriter, outside: PerformersAndNetworks, clock_name: str, only: str = ""
) -> None:
    """Measure who was not measured yet, and report."""
    cache, clock = writer.cache(only), clock_named(clock_name)
    conditions = {
        "frames": FRAMES,
        "size": SIZE_PX,
        "budget_s": BUDGET_S,
        "covered_share": COVERED_SHARE,
        "rest_share": REST_SHARE,
        "lpips": outside.backbone.name,
        **clock.about(),
    }
    rows = []
    for name, poses in product(PERFORMERS, POSES):
        row = cache.measured(
            f"{name}-{poses}",
            conditions,
            lambda who=name, how=poses: measure(who, how, outside, clock, BUDGET_S),
        )
        if row is not None:
            rows.append({"performer": name, "poses": poses, **row})
    writer.write({**conditions, "must": MUST, "aim": AIM, "rows": rows})


def measure(
    name: str, poses: str, outside: PerformersAndNetworks, clock: Clock, budget_s: float
) -> dict[str, Any]:
    """LPIPS of the torso that hands covered, and of the rest of it, hands away."""
    performer = make_lifelike_performer(LIFELIKE_PERFORMERS[name], outside.assets)
    camera = orbit_camera(_TARGET, _DISTANCE_M, 0.0, 0.0, SIZE_PX, SIZE_PX, _FIELD_OF_VIEW_RAD)
    scene, lpips = Covered(performer, camera), Lpips(outside.backbone)
    skeleton = performer.body.skeleton
    clip, away = hands_before_chest(skeleton, FRAMES), hands_away(TEST_FRAMES)
    with tempfile.TemporaryDirectory() as folder:
        captured = poses == "captured"
        film = (scene, clip, away, Path(folder))
        sequence, judged = _captured(*film, outside) if captured else _known(*film)
        model = train(
            sequence, preset="splats", budget_s=budget_s, find_light=True, clock=clock.now
        )
        aligner = Aligner(model, sequence) if captured else None
    hidden, joints = scene.hidden_shares(clip), scene.joints
    found: dict[str, list[float]] = {"covered": [], "rest": []}
    shares: dict[str, list[float]] = {"covered": [], "rest": []}
    for number, truth in enumerate(judged):
        pose = truth.pose if aligner is None else aligner.align(truth)
        made = np.clip(model.render(truth.camera, pose)[..., :3], 0.0, 1.0)
        triangle = scene.triangles(away.pose(number))
        torso = (triangle >= 0) & np.isin(joints[triangle], _TORSO_JOINTS)
        parts = {
            "covered": torso & (hidden[triangle] >= COVERED_SHARE),
            "rest": torso & (hidden[triangle] <= REST_SHARE),
        }
        for part, where in parts.items():
            found[part].append(part_lpips(lpips, made, truth.image, where))
            shares[part].append(float(where.sum() / max(torso.sum(), 1)))
    covered, rest = (float(np.mean(found[part])) for part in ("covered", "rest"))
    row = {
        "lpips_covered": round(covered, 4),
        "lpips_rest": round(rest, 4),
        "lpips_more": round(covered - rest, 4),
        **{f"{part}_of_torso": round(float(np.mean(shares[part])), 3) for part in shares},
    }
    print(name, poses, row, flush=True)
    return row


def _known(
    scene: Covered, clip: Motion, away: Motion, folder: Path
) -> tuple[Sequence, list[Frame]]:
    """What is trained on, and the frames that judge: poses, masks and camera are exact."""
    write_sequence(
        folder / "clip",
        person="known",
        frames_per_second=RATE_HZ,
        body=scene.performer.known_body,
        train=(_frame(scene, clip.pose(number)) for number in range(len(clip))),
        source="hands before the chest",
        pose_trust=PoseTrust.EXACT,
    )
    frames = [_frame(scene, away.pose(number)) for number in range(len(away))]
    return open_sequence(folder / "clip"), frames


def _captured(
    scene: Covered, clip: Motion, away: Motion, folder: Path, outside: PerformersAndNetworks
) -> tuple[Sequence, list[Frame]]:
    """The same from pixels: both motions are one film before a room, which is captured; its first
    part is trained on. Only the focal length is known."""
    poses = [motion.pose(number) for motion in (clip, away) for number in range(len(motion))]
    filmed = [_frame(scene, pose) for pose in poses]
    footage = Footage(folder / "film", background="textured")
    with FootageWriter(footage, scene.camera, RATE_HZ, _ROOM_SEED) as film:
        for frame in filmed:
            film.add(frame.image, frame.mask)
    focal_px = float(scene.camera.intrinsics[0, 0])
    options = CaptureOptions(
        person="captured",
        pose_model=outside.pose,
        face_model=outside.face,
        hand_model=outside.hand,
        focal_px=focal_px,
    )
    capture_clip(footage.path, folder / "clip", options)
    captured = open_sequence(folder / "clip")
    times_s = read_clip(footage.path, len(poses)).times_s
    size = (scene.camera.width, scene.camera.height)
    camera = whole_camera(captured.train.camera(0), focal_px, size)
    judged = [
        Frame(frame.image, frame.mask, camera, captured.motion.pose_at(float(time_s)))
        for frame, time_s in zip(filmed[len(clip) :], times_s[len(clip) :], strict=True)
    ]
    before = captured.motion.times_s < times_s[len(clip)] - 1e-6
    return captured.part(np.flatnonzero(before).tolist()), judged


@torch.no_grad()
def part_lpips(
    lpips: Lpips,
    made: Float[Array, "H W 3"],
    truth: Float[Array, "H W 3"],
    where: Bool[Array, "H W"],
) -> float:
    """LPIPS of the truth in which `where` alone is the model's, over that part's share of it."""
    mixed = np.where(where[..., None], made, truth)
    pair = [
        torch.from_numpy(np.ascontiguousarray(one, np.float32)).movedim(-1, 0)[None]
        for one in (mixed, truth)
    ]
    return float(lpips(*pair)[0]) / max(float(where.mean()), 1e-6)


def hands_away(frames: int) -> Motion:
    """Arms hang; the trunk turns a little to and fro."""
    motion = turntable_motion(frames, RATE_HZ, 0.0)
    phase = 2.0 * np.pi * np.arange(frames) / frames
    motion.joint_angles[:, 0, 1] = _TURN_RAD * np.sin(phase)
    return motion


def hands_before_chest(skeleton: Skeleton, frames: int) -> Motion:
    """The same, while each wrist goes round before its side of the chest."""
    motion = hands_away(frames)
    angles = motion.joint_angles.copy()
    arms = {side: arm_joints(side) for side in ("left", "right")}
    for number in range(frames):
        phase = 2.0 * np.pi * 3.0 * number / frames
        for side, sign in (("left", 1.0), ("right", -1.0)):
            middle = skeleton.rest_joints[JOINT_NAMES.index("spine3")]
            off = np.array(
                [sign * _REACH_M * np.cos(phase), _UP_M * np.sin(phase + sign), _BEFORE_CHEST_M]
            )
            angles[number, arms[side]] = reaching(skeleton, arms[side], sign, middle + off)
    return replace(motion, joint_angles=angles)


def arm_joints(side: str) -> list[int]:
    """Shoulder, elbow and wrist of `left` or `right`."""
    return [JOINT_NAMES.index(f"{side}_{part}") for part in ("shoulder", "elbow", "wrist")]


def reaching(
    skeleton: Skeleton, arm: list[int], sign: float, wrist: Float[Array, "3"]
) -> Float[Array, "3 3"]:
    """Rotations (rad) of the joints `arm` that bring the wrist there (m), the trunk at rest.

    `sign` is 1 for the left arm, -1 for the right.
    """
    hanging = axis_angle_to_matrix(np.array([0.0, 0.0, -1.1 * sign]))

    def rotations(numbers: Array) -> Float[Array, "3 3"]:
        shoulder = hanging @ axis_angle_to_matrix(numbers[:3])
        bend = np.array([0.0, -sign * numbers[3], 0.0])
        return np.stack([matrix_to_axis_angle(shoulder), bend, np.zeros(3)])

    def off(numbers: Array) -> Array:
        angles = np.zeros((len(JOINT_NAMES), 3))
        angles[arm] = rotations(numbers)
        placed = skeleton.joint_transforms(angles, np.zeros(3))[arm[2], :3, 3]
        return np.concatenate([10.0 * (placed - wrist), 0.1 * (numbers - start)])

    start = np.array([0.8, 0.0, 0.0, 1.8])
    bounds = ([-2.5, -2.5, -2.5, 0.1], [2.5, 2.5, 2.5, 2.5])
    return rotations(least_squares(off, start, bounds=bounds).x)


def _frame(scene: Covered, pose: Pose) -> Frame:
    image, mask = scene.performer.render(pose, scene.camera, "plain")
    return Frame(image, mask, scene.camera, pose)
