"""Writes what the solver makes of real landmarks, which the page's solver is held to.

    python -m tools.build_motion_cases UPPER_BODY.mp4 WHOLE_BODY.mp4

MediaPipe's landmarks of two clips, then of the first again after a gap, in a picture of another
size, of somebody too small and of somebody outside of the picture; with made-up faces, heads and
hands, which come and go. Beside them how a head is turned by a face's points. Each sequence is
solved from nothing. The numbers that go in are whole in float32 and times in microseconds, so that
page and server read the same.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from capture.body.expressions import FACE, LEFT_HAND, RIGHT_HAND, ObservedExpression
from capture.body.inverse_kinematics import OPENCV_TO_OPENGL
from capture.body.landmarks import landmarks_on
from capture.body.model import load_body_model
from capture.detection.face_and_hands import PartLandmarks
from capture.detection.landmarks import MediaPipeEstimator
from capture.detection.network_files import landmark_network_file
from capture.detection.rigid_parts import HEAD_POINTS, head_rotation, rest_points
from capture.detection.tracking import track_person
from capture.live.solver_constants import solver_constants
from capture.sources.video import read_video
from scene.arrays import Array
from scene.body import Body
from scene.errors import InvalidInput
from scene.expression import EXPRESSION_COUNT
from scene.motion import Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import Skeleton
from services.live.keypoints_packet import KeypointsPacket
from services.live.motion.expression_filter import HeldExpression
from services.live.motion.motion_packet import MotionPacket, encode_motion
from services.live.motion.motion_solver import MotionSolver
from services.live.motion.solved_motion import LocalPose, SolvedMotion, SolvedPose, usual_camera
from services.settings import load_settings

MOTION_CASES = Path(__file__).resolve().parents[1] / "tests" / "services" / "live" / "motion.json"
_FRAMES = 70
"""Of each clip: more than two seconds, in which the lifter is asked again."""
_AGAIN = 12
"""Frames of the first clip after it was interrupted."""
_YAWS_RAD = (0.25, -0.5)
_EACH = 5
"""Of so many frames one tells the motion whole, and its packet."""
_AGE_MS = 72


def main() -> None:
    """Write the cases anew."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("clips", nargs=2, type=Path, help="an upper body, then a whole one")
    upper, whole = (_packets(clip) for clip in parser.parse_args().clips)
    sequences = [_interrupted(upper), whole]
    told = {
        "people": _people(),
        "cases": [case_of(one, yaw) for one, yaw in zip(sequences, _YAWS_RAD, strict=True)],
        "head": _turned_head(),
    }
    MOTION_CASES.write_text(json.dumps(told, separators=(",", ":")) + "\n")


def _people() -> dict[str, list[float]]:
    """What holds for everybody, but for the lifter's weights, which lie beside `capture`."""
    sizes = {"mean": 72, "axes": 216, "stiffness": 72, "landmarks": 99, "head": 99}
    numbers = iter(np.frombuffer(solver_constants(), "<f4", sum(sizes.values())).tolist())
    return {name: list(islice(numbers, size)) for name, size in sizes.items()}


def _turned_head() -> dict[str, Any]:
    """A face that is turned, off the picture's middle, with noise, and what head it makes."""
    rng, (width, height) = np.random.default_rng(0), (640, 480)
    turned = rest_points("head") @ axis_angle_to_matrix(np.array([0.2, -0.5, 0.1])).T
    shape = np.zeros((478, 3))
    shape[list(HEAD_POINTS)] = (
        900.0 * turned * OPENCV_TO_OPENGL + rng.normal(size=turned.shape)
    ).round(3)
    middle = np.array([150.0, 330.0])
    face = PartLandmarks(np.tile(middle, (478, 1)), shape)
    return {
        "width": width,
        "height": height,
        "middle": middle.tolist(),
        "points": _rounded(shape[list(HEAD_POINTS)], 3),
        "rotation": _rounded(head_rotation(face, usual_camera(width, height)), 9),
    }


def case_of(packets: list[KeypointsPacket], yaw_rad: float) -> dict[str, Any]:
    """A body, what its webcam saw, and what it comes to, as JSON."""
    skeleton = Skeleton(_whole(load_body_model().rest_joints * [1.0, 1.04, 1.0]))
    landmarks, _ = landmarks_on(Body(skeleton))
    solver = MotionSolver(skeleton, yaw_rad)
    frames = [
        _told(packet) | {"motion": _solved(solver, packet, whole=number % _EACH == 0)}
        for number, packet in enumerate(packets)
    ]
    return {
        "body": {
            "rest": _rounded(skeleton.rest_joints, 9),
            "landmarks": _rounded(landmarks, 9),
            "yaw": yaw_rad,
        },
        "frames": frames,
    }


def packet_of(frame: dict[str, Any], sequence: int = 0) -> KeypointsPacket:
    """What a webcam saw, from a frame of `case_of`."""
    told = frame["expression"]
    return KeypointsPacket(
        sequence,
        frame["time_ms"],
        frame["width"],
        frame["height"],
        _whole(frame["xy"]).reshape(-1, 2),
        _whole(frame["world"]).reshape(-1, 3),
        _whole(frame["visibility"]),
        None if told is None else ObservedExpression(_whole(told["values"]), told["known"]),
        head=None if frame["head"] is None else axis_angle_to_matrix(np.array(frame["head"])),
    )


def _told(packet: KeypointsPacket) -> dict[str, Any]:
    told = packet.expression
    return {
        "time_ms": packet.capture_time_ms,
        "width": packet.width,
        "height": packet.height,
        "xy": _rounded(packet.xy, 5),
        "world": _rounded(packet.world, 4),
        "visibility": _rounded(packet.visibility, 3),
        "expression": told and {"values": _rounded(told.values, 3), "known": told.known},
        "head": None if packet.head is None else _rounded(matrix_to_axis_angle(packet.head), 5),
    }


def _solved(solver: MotionSolver, packet: KeypointsPacket, *, whole: bool) -> dict[str, Any] | None:
    try:
        motion = solver.solve(packet_of(_told(packet)))
    except InvalidInput:
        return None
    told = {
        "local": _rounded(matrix_to_axis_angle(motion.now.local), 6),
        "root": _rounded(motion.now.root, 6),
        "locked": list(motion.feet_locked),
        "expression": _rounded(motion.expression.at(motion.time_s), 6),
        "more": None,
    }
    if whole:
        assert motion.seen is not None
        more: dict[str, Any] = {
            "ahead": _rounded(motion.ahead, 6),
            "ahead_root": _rounded(motion.ahead_m, 6),
            "seen": _rounded(motion.seen.pose.joint_angles, 6),
            "seen_root": _rounded(motion.seen.pose.root_translation, 6),
        }
        told["more"] = more
        rounded = motion_of(_told(packet) | {"motion": told})
        more["packet"] = encode_motion(MotionPacket(7, rounded, live_look=True)).hex()
    return told


def motion_of(frame: dict[str, Any]) -> SolvedMotion:
    """What a picture came to, from a frame that tells `more`."""
    told, time_s = frame["motion"], frame["time_ms"] / 1e3
    more, expression = told["more"], np.array(told["expression"])
    angles = np.reshape(more["seen"], (-1, 3))
    seen = SolvedPose(
        frame["time_ms"],
        Pose(angles, np.array(more["seen_root"]), time_s, expression),
        usual_camera(frame["width"], frame["height"]),
    )
    left, right = told["locked"]
    return SolvedMotion(
        frame["time_ms"],
        LocalPose(axis_angle_to_matrix(np.reshape(told["local"], (-1, 3))), np.array(told["root"])),
        np.reshape(more["ahead"], (-1, 3)),
        np.array(more["ahead_root"]),
        (left, right),
        HeldExpression(expression, np.full(EXPRESSION_COUNT, time_s)),
        _AGE_MS,
        seen,
    )


def _packets(clip: Path) -> list[KeypointsPacket]:
    """MediaPipe's landmarks of the first frames."""
    video = read_video(clip, max_frames=_FRAMES)
    model = landmark_network_file(load_settings().pose_model_source())
    with MediaPipeEstimator(model) as estimator:
        people = track_person(video.images, estimator).people
    height, width = video.images[0].shape[:2]
    return [
        KeypointsPacket(
            number,
            round(1e3 * float(time_s), 3),
            width,
            height,
            person.pixels / [width, height],
            person.world,
            person.visibility,
            _expression(number),
            head=_head(number),
        )
        for number, (person, time_s) in enumerate(zip(people, video.times_s, strict=True))
        if person is not None
    ]


def _interrupted(packets: list[KeypointsPacket]) -> list[KeypointsPacket]:
    """These packets, then what a solver has to live through, at the same pace."""
    step_ms = np.median([b.capture_time_ms - a.capture_time_ms for a, b in pairwise(packets)])
    again, first = packets[:_AGAIN], packets[0]
    more = [
        *again,
        *(replace(one, width=one.height, height=one.width) for one in again),
        replace(first, xy=0.01 * first.xy + 0.5),
        replace(first, xy=first.xy + 2.0),
        *again,
    ]
    # longer than a pose can be gone on from
    start_ms = packets[-1].capture_time_ms + 700.0
    return [
        *packets,
        *(
            replace(one, capture_time_ms=round(start_ms + n * float(step_ms), 3))
            for n, one in enumerate(more)
        ),
    ]


def _expression(number: int) -> ObservedExpression | None:
    """A face twice in three pictures, a hand at times, and nothing for a second."""
    if 30 <= number < 60:
        return None
    known = (FACE if number % 3 else 0) | (LEFT_HAND if number % 5 == 0 else 0)
    known |= RIGHT_HAND if number > 60 else 0
    phases = np.arange(EXPRESSION_COUNT) + 0.35 * number
    return ObservedExpression(0.5 + 0.5 * np.sin(phases), known) if known else None


def _head(number: int) -> Array | None:
    """In one of three pictures, then in none for longer than it is held, then nowhere near."""
    if number % 3 or 20 <= number < 55:
        return None
    far = 3.0 if number > 62 else 0.0
    return axis_angle_to_matrix(np.array([-0.3, 0.4 * np.sin(0.3 * number), 0.1 + far]))


def _whole(values: Any) -> Array:
    """As float32 holds them."""
    return np.asarray(values, np.float32).astype(np.float64)


def _rounded(values: Array, digits: int) -> list[float]:
    return [round(float(one), digits) for one in np.ravel(values)]


if __name__ == "__main__":
    main()
