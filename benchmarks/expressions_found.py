"""How well a face, its gaze and fingers are found from pictures: lifelike performers, who know.

Each performer talks, blinks, looks about and gestures (`capture.studio.expressions`) before a still
camera, once per part, at the size at which a webcam shows it: head turned by up to 35 degrees, palm
seen from up to 30 degrees aside.
What captures and pages compute from the landmarks is compared with what was performed.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.reporting.figures import FigureWriter
from capture.body.expressions import face_measures, face_numbers, finger_curls, resting_face
from capture.body.landmark_names import FACE_LANDMARKS, LANDMARK_NAMES
from capture.detection.face_and_hands import SIDES, FaceAndHandDetector
from capture.detection.landmarks import Landmarks
from capture.studio.expressions import with_random_expressions
from capture.studio.lifelike.performer import DressedPerformer, make_lifelike_performer
from capture.studio.motions import turntable_motion
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera, orbit_camera
from scene.expression import EXPRESSION_NAMES, GAZE, PARTS, gaze_of
from scene.motion import Motion, Pose
from scene.skeleton import HEAD, JOINT_NAMES

PICTURES, SIZE_PX = 30, 256
"""Of each part of each performer."""
_BETWEEN_S = 0.9
"""From one picture to the next of what is performed: eyes rest for 0.7 s."""
_FACE = np.array([0.0, 0.09, 0.08])
"""From the head's joint, m."""
_FACE_DISTANCE_M, _HAND_DISTANCE_M, _FIELD_OF_VIEW_RAD = 0.7, 0.5, 0.5
_FACE_ASIDE_RAD, _HAND_ASIDE_RAD, _UP_RAD = 0.6, 0.5, 0.15
_PALMS_TO_CAMERA = np.array([-0.5 * np.pi, 0.0, 0.0])
"""Of the whole body: in the T-pose they face down."""
_FINGER_DEG, _THUMB_DEG = 175.0 / 3.0, 90.0 / 3.0
"""How far each joint of a finger bends where its curl is 1 (`tools.build_expressions`)."""


def run(writer: FigureWriter, assets: Path, face_model: Path, hand_model: Path) -> None:
    """Film, look, compare, and report."""
    rows = []
    with FaceAndHandDetector(face_model, hand_model) as detector:
        for name, row in LIFELIKE_PERFORMERS.items():
            performer = make_lifelike_performer(row, assets, expressive=True)
            rng = np.random.default_rng(row.seed)
            found = {"performer": name, **_face(performer, detector, rng)}
            for side in SIDES:
                found[f"{side}_hand"] = _hand(performer, detector, side, rng)
            rows.append(found)
            print(found, flush=True)
    writer.write({"pictures": PICTURES, "size": SIZE_PX, "means": mean_errors(rows), "rows": rows})


def _face(
    performer: DressedPerformer, detector: FaceAndHandDetector, rng: np.random.Generator
) -> dict[str, Any]:
    """Mean errors of the gaze aside, degrees, and of each other number of a face, beside how far
    eyes look aside, and how far the number is spread."""
    performed = performances(rng)
    target = performer.body.skeleton.rest_joints[HEAD] + _FACE
    shown, measures = [], []
    for pose in performed:
        camera = _camera(target, _FACE_DISTANCE_M, _FACE_ASIDE_RAD, rng)
        middle, half_px = np.full(2, 0.5 * SIZE_PX), 0.5 * SIZE_PX
        face = detector.face_about(_picture(performer, pose, camera), middle, half_px)
        if face is not None and (measured := face_measures(face.shape)) is not None:
            shown.append(pose.expression)
            measures.append(measured)
    truth, rest = np.array(shown), resting_face(np.array(measures))
    numbers = np.array([face_numbers(measured, rest) for measured in measures])
    told = np.zeros_like(truth)
    told[:, PARTS["face"]] = numbers
    skin = {
        EXPRESSION_NAMES[number]: {
            "error": _rounded(np.abs(told[:, number] - truth[:, number]).mean()),
            "spread": _rounded(truth[:, number].std()),
        }
        for number in range(GAZE.start)
    }
    return {
        "faces": len(shown),
        "gaze_deg": _rounded(np.degrees(np.abs(gaze_of(told) - gaze_of(truth))).mean()),
        "gaze_spread_deg": _rounded(np.degrees(np.abs(gaze_of(truth))).mean()),
        "skin": skin,
    }


def _hand(
    performer: DressedPerformer, detector: FaceAndHandDetector, side: str, rng: np.random.Generator
) -> dict[str, Any]:
    """Mean error of the joints of thumb and fingers, degrees."""
    skeleton, errors = performer.body.skeleton, []
    wrist, knuckles = (JOINT_NAMES.index(f"{side}_{part}") for part in ("wrist", "hand"))
    for pose in performances(rng, _PALMS_TO_CAMERA):
        joints = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)[:, :3, 3]
        camera = _camera(joints[knuckles], _HAND_DISTANCE_M, _HAND_ASIDE_RAD, rng)
        person = around_a_hand(side, *camera.project(joints[[wrist, knuckles]])[0])
        hand = detector.hands(_picture(performer, pose, camera), person)[SIDES.index(side)]
        if hand is not None:
            off = finger_curls(hand.landmarks.shape) - pose.expression[PARTS[f"{side}_hand"]]
            errors.append(np.abs(off) * [_THUMB_DEG, *[_FINGER_DEG] * 4])
    if not errors:
        return {"found": 0, "joints_deg": None, "fingers_deg": None}
    by_finger = np.mean(errors, axis=0)
    return {
        "found": len(errors),
        "joints_deg": _rounded(by_finger.mean()),
        "fingers_deg": [_rounded(one) for one in by_finger],
    }


def performances(rng: np.random.Generator, turned: Float[Array, "3"] | None = None) -> list[Pose]:
    """Poses at rest but for what face and hands do, seconds apart."""
    still = turntable_motion(round(PICTURES * _BETWEEN_S * 10.0), 10.0, 0.0)
    motion: Motion = with_random_expressions(still, int(rng.integers(1 << 30)))
    at_rest = Pose.rest()
    if turned is not None:
        at_rest.joint_angles[0] = turned
    moments = np.arange(PICTURES) * round(10.0 * _BETWEEN_S)
    return [replace(at_rest, expression=motion.expressions[moment]) for moment in moments]


def _camera(
    target: Float[Array, "3"], distance_m: float, aside_rad: float, rng: np.random.Generator
) -> Camera:
    aside, up = rng.uniform(-1.0, 1.0, 2) * [aside_rad, _UP_RAD]
    return orbit_camera(target, distance_m, aside, up, SIZE_PX, SIZE_PX, _FIELD_OF_VIEW_RAD)


def _picture(performer: DressedPerformer, pose: Pose, camera: Camera) -> UInt8[Array, "H W 3"]:
    colour, alpha = performer.render(pose, camera, "plain")
    over_grey = colour + 0.5 * (1.0 - alpha[..., None])
    return np.rint(255.0 * np.clip(over_grey, 0.0, 1.0)).astype(np.uint8)


def around_a_hand(side: str, wrist: Float[Array, "2"], knuckles: Float[Array, "2"]) -> Landmarks:
    """The landmarks about which the hand of `side` is looked for, and no other."""
    pixels, seen = np.zeros((len(LANDMARK_NAMES), 2)), np.zeros(len(LANDMARK_NAMES))
    for part, at in (("wrist", wrist), *((p, knuckles) for p in ("pinky", "index", "thumb"))):
        pixels[LANDMARK_NAMES.index(f"{side}_{part}")] = at
        seen[LANDMARK_NAMES.index(f"{side}_{part}")] = 1.0
    # the head's extent sets the size of the square in which a hand is looked for
    pixels[:FACE_LANDMARKS, 0] = np.linspace(0.0, 0.25 * SIZE_PX, FACE_LANDMARKS)
    return Landmarks(pixels, np.zeros((len(pixels), 3)), seen, np.zeros((0, 0), np.float32))


def mean_errors(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Over performers, of whom hands that were not found are left out."""
    names = ("gaze_deg", "gaze_spread_deg")
    means = {name: _rounded(np.mean([row[name] for row in rows])) for name in names}
    hands = [row[f"{side}_hand"] for row in rows for side in SIDES]
    joints = [hand["joints_deg"] for hand in hands if hand["found"]]
    means["finger_joints_deg"] = _rounded(np.mean(joints))
    means["hands_found"] = _rounded(sum(hand["found"] for hand in hands) / len(hands) / PICTURES)
    return means


def _rounded(value: float | np.floating) -> float:
    return round(float(value), 3)
