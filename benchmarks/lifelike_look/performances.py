"""What lifelike performers do: the clip that is trained on, and what they do at their webcam later.

The clip shows them from the waist up while they turn once, their face at rest and their arms
hanging. Later a hand goes across the chest and back; or the face talks, smiles and blinks; in the
light of the clip, in which only what is new differs from the model, or in that of a lamp aside.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.covered_torso import arm_joints, reaching
from capture.storage import open_sequence, write_sequence
from capture.studio.lifelike.performer import DressedPerformer
from capture.studio.light import EnvironmentLight
from capture.studio.motions import turntable_motion
from scene.arrays import Array, Float
from scene.camera import Camera, orbit_camera
from scene.expression import EXPRESSION_COUNT, EXPRESSION_NAMES
from scene.lighting import panorama_directions
from scene.motion import Motion, Pose
from scene.sequence import Frame, PoseTrust, Sequence
from scene.skeleton import JOINT_NAMES, Skeleton

SUPERSAMPLING = 3
"""Samples a pixel side."""
FRAMES, RATE_HZ, SIZE_PX = 60, 10.0, 512
_TARGET, _DISTANCE_M, _FIELD_OF_VIEW_RAD = (0.0, 1.25, 0.0), 1.6, 0.6
WEBCAM_PX = (640, 480)
_WEBCAM_TARGET, _WEBCAM_M = (0.0, 1.33, 0.0), 1.1
_FOCAL = 0.87
"""Of usual webcams, in their pictures' width: what live motion takes them for."""
PLAYED_HZ, SECONDS = 20.0, 4.0
"""Pictures that the webcam takes, of which it sends every other."""
_BEFORE_CHEST_M, _ASIDE_M, _ACROSS_M, _UP_M = 0.25, 0.06, 0.15, 0.06
_ACROSS_S = 4.0
"""From one side of the chest to the other and back."""
_SWAY_RAD = 0.06
_PERIODS_S = {"jaw_open": 1.1, "smile": 2.6, "brows_up": 1.7}
_BLINK_S, _BLINKS_S = 0.12, (0.9, 2.7)
_FACE_M, _FACE_HALF_M = np.array([0.0, 0.01, 0.08]), 0.095
"""From the head's joint to the middle of the face, and half its side."""
_HAND_HALF_M = 0.11
HAND, EXPRESSION = "hand across the chest", "new expression"
LAMP = "by a lamp"
_AMBIENT, _LAMP = np.array([0.36, 0.38, 0.42]), np.array([3.2, 2.6, 1.8])
"""Linear RGB of the room and of the lamp in it; 1 is the light of the clip."""
_TO_LAMP, _LAMP_RAD = np.array([0.75, 0.3, 0.6]), 0.5
"""Where it stands, and half of how large it is seen."""


@dataclass(frozen=True, eq=False)
class Performance:
    """One performer doing one thing before their webcam."""

    name: str
    performer: DressedPerformer
    motion: Motion
    """What they do, a pose a picture."""
    webcam: Camera
    light: EnvironmentLight | None = None
    """None: that of the clip."""

    def truth(self, number: int, degrees: float = 0.0, supersampling: int = SUPERSAMPLING) -> Frame:
        """Pose `number` of the motion, from so far beside the webcam; sRGB over black."""
        pose = self.motion.pose(number)
        camera = beside(self.webcam, pose, self.performer.body.skeleton, degrees)
        look = "plain" if self.light is None else "lit"
        image, mask = self.performer.render(
            pose, camera, look, light=self.light, supersampling=supersampling
        )
        return Frame(image, mask, camera, pose)

    def part(self, frame: Frame) -> tuple[slice, slice] | None:
        """Rows and columns of what is new in `frame`: the hand, or the face."""
        body, pose = self.performer.body, frame.pose
        joints = body.skeleton.joint_transforms(pose.joint_angles, pose.root_translation)
        if self.name.startswith(HAND):
            place, half_m = joints[JOINT_NAMES.index("right_hand"), :3, 3], _HAND_HALF_M
        else:
            head = joints[JOINT_NAMES.index("head")]
            place, half_m = head[:3, 3] + head[:3, :3] @ _FACE_M, _FACE_HALF_M
        return _square(frame.camera, place, half_m)


def beside(camera: Camera, pose: Pose, skeleton: Skeleton, degrees: float) -> Camera:
    """`camera`, carried round the vertical through the chest to the person's left.

    The pelvis is out of the picture, and far from where it is taken to be.
    """
    joints = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)
    chest = joints[JOINT_NAMES.index("spine3"), :3, 3]
    return camera.carried_round(chest, np.radians(degrees))


def webcam_camera() -> Camera:
    """A laptop's, before the chest."""
    field_of_view = 2.0 * float(np.arctan(0.5 * WEBCAM_PX[1] / (_FOCAL * WEBCAM_PX[0])))
    return orbit_camera(_WEBCAM_TARGET, _WEBCAM_M, 0.0, 0.0, *WEBCAM_PX, field_of_view)


def performances(performer: DressedPerformer) -> list[Performance]:
    """All that `performer` does."""
    hand, face = hand_across_chest(performer.body.skeleton), new_expression()
    webcam, lamp = webcam_camera(), lamp_aside()
    return [
        Performance(HAND, performer, hand, webcam),
        Performance(EXPRESSION, performer, face, webcam),
        Performance(f"{HAND}, {LAMP}", performer, hand, webcam, lamp),
        Performance(f"{EXPRESSION}, {LAMP}", performer, face, webcam, lamp),
    ]


def lamp_aside() -> EnvironmentLight:
    """A dim room with a warm lamp at one side."""
    directions = panorama_directions(24, 48)
    to_lamp = _TO_LAMP / np.linalg.norm(_TO_LAMP)
    is_lamp = directions @ to_lamp > np.cos(_LAMP_RAD)
    return EnvironmentLight(np.where(is_lamp[..., None], _LAMP, _AMBIENT).astype(np.float32))


def trained_clip(performer: DressedPerformer, name: str, folder: Path) -> Sequence:
    """A full turn from the waist up, with exact poses; written to `folder`."""
    camera = orbit_camera(_TARGET, _DISTANCE_M, 0.0, 0.0, SIZE_PX, SIZE_PX, _FIELD_OF_VIEW_RAD)
    motion = turntable_motion(FRAMES, RATE_HZ, 360.0)

    def frame(number: int) -> Frame:
        image, mask = performer.render(
            motion.pose(number), camera, "plain", supersampling=SUPERSAMPLING
        )
        return Frame(image, mask, camera, motion.pose(number))

    write_sequence(
        folder,
        person=name,
        frames_per_second=RATE_HZ,
        body=performer.known_body,
        train=(frame(number) for number in range(FRAMES)),
        source="a turn from the waist up",
        pose_trust=PoseTrust.EXACT,
    )
    return open_sequence(folder)


def _swaying() -> Motion:
    """Somebody at a webcam who hardly moves, arms hanging."""
    count = round(PLAYED_HZ * SECONDS)
    motion = turntable_motion(count, PLAYED_HZ, 0.0)
    phase = 2.0 * np.pi * np.arange(count) / count
    angles = np.repeat(motion.joint_angles[:1], count, axis=0)
    angles[:, 0, 1] = _SWAY_RAD * np.sin(phase)
    angles[:, JOINT_NAMES.index("head"), 1] = -_SWAY_RAD * np.sin(phase)
    return replace(motion, joint_angles=angles)


def hand_across_chest(skeleton: Skeleton) -> Motion:
    """The right hand goes across the chest to the left side and back."""
    motion, arm = _swaying(), arm_joints("right")
    angles = motion.joint_angles.copy()
    middle = skeleton.rest_joints[JOINT_NAMES.index("spine3")]
    for number, time_s in enumerate(motion.times_s):
        phase = 2.0 * np.pi * time_s / _ACROSS_S
        across_m = -_ASIDE_M - _ACROSS_M * np.cos(phase)
        off = np.array([across_m, _UP_M * np.sin(2.0 * phase), _BEFORE_CHEST_M])
        angles[number, arm] = reaching(skeleton, arm, -1.0, middle + off)
    return replace(motion, joint_angles=angles)


def new_expression() -> Motion:
    """Talks, smiles, raises the brows and blinks."""
    motion = _swaying()
    shown = np.zeros((len(motion), EXPRESSION_COUNT))
    for name, period_s in _PERIODS_S.items():
        wave = 0.5 - 0.5 * np.cos(2.0 * np.pi * motion.times_s / period_s)
        shown[:, EXPRESSION_NAMES.index(name)] = wave
    for at_s in _BLINKS_S:
        closed = np.exp(-0.5 * ((motion.times_s - at_s) / _BLINK_S) ** 2)
        for side in ("left", "right"):
            lid = shown[:, EXPRESSION_NAMES.index(f"blink_{side}")]
            lid[:] = np.maximum(lid, closed)
    return replace(motion, expressions=shown)


def _square(camera: Camera, place: Float[Array, "3"], half_m: float) -> tuple[slice, slice] | None:
    """Rows and columns about a place; None where too little of it is in the picture."""
    pixels, depth = camera.project(place[None])
    half = half_m * camera.focal_px / depth[0]
    sides = [
        slice(max(0, round(at - half)), min(side, round(at + half)))
        for at, side in zip(pixels[0], (camera.width, camera.height), strict=True)
    ]
    if any(side.stop - side.start < 0.5 * half for side in sides):
        return None
    return sides[1], sides[0]
