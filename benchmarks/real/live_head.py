"""Real heads, live: how far they are from where their faces' points have them.

Each clip is played as a webcam. Every third picture is searched for a face, and what it tells comes
two pictures late, as on a page; the head is judged in every picture that shows a face.
"""

from __future__ import annotations

from collections.abc import Sequence as Many
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.real.cases import CASES
from benchmarks.real.ruler import Ruler
from benchmarks.reporting.figures import FigureWriter
from capture.body.model import load_body_model
from capture.detection.face_and_hands import FaceAndHandDetector
from capture.detection.landmarks import MediaPipeEstimator
from capture.detection.lifter import lift
from capture.detection.rigid_parts import head_rotation
from capture.live.solver import LiveSolver
from capture.sources.clips import read_clip
from scene.arrays import Array, Float
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from services.live.eye_level import head_in_room
from services.live.motion.head_following import HeadFollowing, ObservedHead
from services.live.motion.solved_motion import usual_camera

CLIPS = tuple(case.trained for case in CASES if case.name != "walker")
"""The walker's face is too small."""
FRAMES, EVERY, LATE = 120, 3, 2
_SETTLED = 10
"""First pictures that are not judged."""
_Heads = Float[Array, "F 3 3"]


def run(writer: FigureWriter, footage: Path, pose_model: Path, face_model: Path) -> None:
    """Measure each clip, and report."""
    with (
        MediaPipeEstimator(pose_model, people=1) as bodies,
        FaceAndHandDetector(face_model, None) as faces,
    ):
        rows = [
            {"clip": clip, **measured(Ruler.read(clip).require_footage(footage), bodies, faces)}
            for clip in CLIPS
        ]
    writer.write({"every": EVERY, "late": LATE, "rows": rows})


def measured(clip: Path, bodies: MediaPipeEstimator, faces: FaceAndHandDetector) -> dict[str, Any]:
    """Errors (degrees) of the heads of one clip, solved from the body alone and followed."""
    film = read_clip(clip, FRAMES)
    height, width = film.images[0].shape[:2]
    camera = usual_camera(width, height)
    solver = LiveSolver(load_body_model().body(np.zeros(5)), camera, lifter=lift)
    following, told = HeadFollowing(), dict[int, ObservedHead]()
    solved, followed, seen = [], [], []
    for index, (image, time_s) in enumerate(zip(film.images, film.times_s.tolist(), strict=True)):
        if not (people := bodies.detect(image)):
            continue
        angles = solver.step(people[0], time_s).joint_angles
        following.update(told.get(index - LATE), angles, time_s)
        if (face := faces.face(image, people[0])) is None:
            continue
        head = ObservedHead(head_rotation(face, camera), time_s)
        if index % EVERY == 0:
            told[index] = head
        solved.append(head_in_room(axis_angle_to_matrix(angles)))
        angles = following.followed(angles, time_s)
        followed.append(head_in_room(axis_angle_to_matrix(angles)))
        seen.append(head.rotation)
    return {
        "pictures": len(seen),
        "solved": errors_deg(solved[_SETTLED:], seen[_SETTLED:]),
        "followed": errors_deg(followed[_SETTLED:], seen[_SETTLED:]),
    }


def errors_deg(heads: Many[Array], seen: Many[Array]) -> dict[str, float]:
    """Angles between them; and how unsteady `heads` are: of the turns from one picture to the next,
    the mean change."""
    ours, theirs = np.array(heads), np.array(seen)
    off = _angles_deg(_between(ours, theirs))
    steps = _between(ours[:-1], ours[1:])
    return {
        "mean": round(float(off.mean()), 1),
        "p95": round(float(np.percentile(off, 95)), 1),
        "unsteady": round(float(_angles_deg(_between(steps[:-1], steps[1:])).mean()), 2),
    }


def _between(one: _Heads, other: _Heads) -> _Heads:
    return np.swapaxes(one, -1, -2) @ other


def _angles_deg(rotations: _Heads) -> Float[Array, "F"]:
    return np.degrees(np.linalg.norm(matrix_to_axis_angle(rotations), axis=-1))
