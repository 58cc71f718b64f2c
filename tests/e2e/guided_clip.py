"""A lifelike performer who does the steps of a guided enrolment, as a webcam's film."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from capture.studio.lifelike.performer import DressedPerformer, make_lifelike_performer
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from capture.studio.room import room_background
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera, orbit_camera
from scene.limits import ELBOW_HINGE
from scene.motion import Pose
from scene.skeleton import JOINT_NAMES

SIZE = (480, 360)
"""px, of the film."""
_RATE_HZ = 30
_J = {name: index for index, name in enumerate(JOINT_NAMES)}
_CAMERA_M = 3.2
"""From the webcam to the far place, where the whole body is seen."""
_CAMERA_HEIGHT_M = 1.4
_LEANING_M = 0.17
"""How much lower somebody is who comes close, to look into the webcam."""
_CLOSE_M, _NEAR_M = 0.55, 1.3
_FOV_Y_RAD = 0.87
_DARK = 0.1
_DOWN_RAD, _OUT_RAD, _RAISED_RAD = 1.4, 0.95, 1.2
"""Of the upper arms, from the T-pose."""


@dataclass(frozen=True)
class Moment:
    """What the webcam shows for `seconds`; angles in degrees to the performer's left."""

    seconds: float
    distance_m: float = _CAMERA_M
    head_deg: float = 0.0
    body_deg: float = 0.0
    arms_rad: float = _DOWN_RAD
    hands_up: float = 0.0
    """Share of the way from hanging forearms to raised hands."""
    light: float = 1.0
    is_empty: bool = False
    pose: Pose = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", self._pose())

    def _pose(self) -> Pose:
        angles = np.zeros((len(JOINT_NAMES), 3))
        angles[0, 1] = np.deg2rad(self.body_deg)
        for joint, share in (("spine2", 0.15), ("spine3", 0.15), ("neck", 0.3), ("head", 0.4)):
            angles[_J[joint], 1] = share * np.deg2rad(self.head_deg)
        for side, sign in (("left", 1.0), ("right", -1.0)):
            raised = self.hands_up * (_RAISED_RAD - self.arms_rad)
            angles[_J[f"{side}_shoulder"], 2] = -sign * (self.arms_rad + raised)
            bend = 0.15 + 2.1 * self.hands_up
            angles[_J[f"{side}_elbow"]] = bend * np.array(ELBOW_HINGE[side])
        lower = -_LEANING_M * (self.distance_m == _CLOSE_M)
        return Pose(angles, np.array([0.0, lower, _CAMERA_M - self.distance_m]))


def moments() -> list[Moment]:
    """Nobody, the dark, then each step as it is asked for, with the way from one to the next."""
    film = [Moment(5.0, is_empty=True), Moment(2.0, _CLOSE_M, light=_DARK), Moment(5.0, _CLOSE_M)]
    for sign in (1.0, -1.0):
        way = [Moment(0.25, _CLOSE_M, head_deg=sign * deg) for deg in (30.0, 55.0)]
        film += [*way, Moment(4.0, _CLOSE_M, head_deg=sign * 78.0), Moment(0.5, _CLOSE_M)]
    film += [Moment(0.3, distance) for distance in np.linspace(_CLOSE_M, _CAMERA_M, 4)[1:-1]]
    film += [Moment(8.0), Moment(4.0, arms_rad=_OUT_RAD)]
    film += [Moment(0.7, body_deg=deg, arms_rad=_OUT_RAD) for deg in range(30, 360, 30)]
    return [*film, Moment(4.0, _NEAR_M), Moment(4.0, _NEAR_M, hands_up=1.0)]


def webcam() -> Camera:
    """Of the film: fixed, level, at the height of a face."""
    target = (0.0, _CAMERA_HEIGHT_M, 0.0)
    return orbit_camera(target, _CAMERA_M, 0.0, 0.0, *SIZE, _FOV_Y_RAD)


def pictures(
    performer: DressedPerformer, film: list[Moment]
) -> Iterator[tuple[Moment, UInt8[Array, "H W 3"]]]:
    """Each moment with its picture."""
    camera = webcam()
    room = room_background(camera, 3)
    made: dict[bytes, Float[Array, "H W 3"]] = {}
    for moment in film:
        angles, place = moment.pose.joint_angles, moment.pose.root_translation
        key = b"" if moment.is_empty else angles.tobytes() + place.tobytes()
        if key not in made:
            made[key] = room
            if key:
                # one sample a pixel: a detector of landmarks does not mind, and it takes a quarter
                image, alpha = performer.render(moment.pose, camera, "plain", supersampling=1)
                made[key] = image + (1.0 - alpha[..., None]) * room
        lit = 255.0 * moment.light * made[key]
        yield moment, np.clip(lit + 0.5, 0.0, 255.0).astype(np.uint8)


def write_guided_clip(out: Path, assets: Path, performer: str = "fern") -> Path:
    """The film as Motion JPEG: Chromium takes it for a camera."""
    subject = make_lifelike_performer(LIFELIKE_PERFORMERS[performer], assets)
    with av.open(str(out), "w", format="mjpeg") as video:
        stream = video.add_stream("mjpeg", rate=_RATE_HZ)
        (stream.width, stream.height), stream.pix_fmt = SIZE, "yuvj420p"
        number = 0
        for moment, picture in pictures(subject, moments()):
            for _ in range(round(moment.seconds * _RATE_HZ)):
                frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
                frame.pts, frame.time_base = number, Fraction(1, _RATE_HZ)
                video.mux(stream.encode(frame))
                number += 1
        video.mux(stream.encode())
    return out
