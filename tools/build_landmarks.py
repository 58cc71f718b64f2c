"""Makes `capture/assets/landmark_offsets.json`: `python -m tools.build_landmarks POSE_MODEL`.

The estimator learnt from clicks on photographs where "hip" or "heel" is; `fit_landmarks` places
both by anatomy. Here studio performers, whose joints are known, are filmed and shown to the
estimator, and one offset a landmark, in the rest axes of its joint, is solved from where it was
seen. Left and right mirror each other. Named performers are not among them.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from capture.body.landmark_names import LANDMARK_COUNT, LANDMARK_NAMES
from capture.body.landmarks import MIRROR, OFFSETS_FILE, BodyLandmarks, place_landmarks
from capture.body.model import load_body_model
from capture.detection.landmarks import Landmarks, MediaPipeEstimator
from capture.studio.motions import gesture_motion, turntable_motion
from capture.studio.performer import make_performer, render_performer
from capture.studio.room import room_background
from scene.arrays import Array, Float
from scene.camera import Camera, orbit_camera
from scene.motion import Pose
from scene.skeleton import Skeleton

SEEDS = range(100, 106)
"""Performers; named performers, demo and benchmarks use smaller numbers."""
_MOMENTS = 24
"""Of each of the two motions, a performer."""
_SIZE_PX = 512
_OUTLIER_M = 0.03
_ROUNDS = 15
_MIRRORED = np.array([-1.0, 1.0, 1.0])

Sight = tuple[Float[Array, "2 3"], Float[Array, "2"], float]
"""How an offset (m) moves a landmark in the picture, how far off it was seen, both in m at the
landmark's depth, and its visibility."""


def main() -> None:
    """Film, look, solve, write."""
    model = load_body_model()
    marks = place_landmarks(model, dict.fromkeys(LANDMARK_NAMES, (0.0, 0.0, 0.0)))
    sights: list[list[Sight]] = [[] for _ in range(LANDMARK_COUNT)]
    with MediaPipeEstimator(Path(sys.argv[1])) as estimator:
        for seed in SEEDS:
            for landmark, more in enumerate(_sights_of(seed, marks, estimator)):
                sights[landmark] += more
            print(f"performer {seed} of {SEEDS[-1]}", flush=True)
    offsets = solve_offsets(sights)
    rounded = {n: [round(float(v), 4) for v in offsets[i]] for i, n in enumerate(LANDMARK_NAMES)}
    OFFSETS_FILE.write_text(json.dumps(rounded, indent=1) + "\n")
    for landmark, name in enumerate(LANDMARK_NAMES):
        before, after = (_median_mm(sights[landmark], o) for o in (np.zeros(3), offsets[landmark]))
        print(f"{name}: {before:.0f} mm beside the anatomical place, {after:.0f} with the offset")


def solve_offsets(sights: list[list[Sight]]) -> Float[Array, "33 3"]:
    """Offsets, m, by robust least squares (Geman-McClure weights), mirrored between the sides."""
    offsets = np.zeros((LANDMARK_COUNT, 3))
    for landmark, partner in enumerate(MIRROR):
        if partner < landmark:
            offsets[landmark] = offsets[partner] * _MIRRORED
            continue
        both = sights[landmark] + [(a * _MIRRORED, off, v) for a, off, v in sights[partner]]
        offsets[landmark] = _solve(both)
    return offsets


def _solve(sights: list[Sight]) -> Float[Array, "3"]:
    moves = np.stack([a for a, _, _ in sights])
    off = np.stack([b for _, b, _ in sights])
    trust = np.array([v for _, _, v in sights]) ** 2
    offset = np.zeros(3)
    for _ in range(_ROUNDS):
        left = np.linalg.norm(off - moves @ offset, axis=1)
        weight = trust / (1.0 + (left / _OUTLIER_M) ** 2) ** 2
        normal = np.einsum("n,nij,nik->jk", weight, moves, moves) + 1e-6 * np.eye(3)
        offset = np.linalg.solve(normal, np.einsum("n,nij,ni->j", weight, moves, off))
    return offset


def _sights_of(seed: int, marks: BodyLandmarks, estimator: MediaPipeEstimator) -> list[list[Sight]]:
    """What the estimator saw of the performer `seed`, a list for each landmark."""
    actor, found = make_performer(seed), [[] for _ in range(LANDMARK_COUNT)]
    skeleton = actor.body.skeleton
    rest = landmarks_of(skeleton, marks)
    camera = orbit_camera((0.0, 0.95, 0.0), 3.6, 0.0, 0.05, _SIZE_PX, _SIZE_PX, 0.6)
    room = room_background(camera, seed)
    for motion in (turntable_motion(_MOMENTS, 10.0, 360.0), gesture_motion(_MOMENTS, 10.0)):
        for pose in map(motion.pose, range(len(motion))):
            image, alpha = render_performer(actor, pose, camera, "lit")
            picture = image + (1.0 - alpha[..., None]) * room
            people = estimator.detect(np.clip(255.0 * picture + 0.5, 0, 255).astype(np.uint8))
            if people:
                person = max(people, key=lambda p: float(p.mask.sum()))
                for landmark, sight in enumerate(
                    sights_in(person, camera, pose, skeleton, rest, marks.joints)
                ):
                    found[landmark].append(sight)
    return found


def sights_in(
    person: Landmarks,
    camera: Camera,
    pose: Pose,
    skeleton: Skeleton,
    rest: Float[Array, "33 3"],
    joints: Array,
) -> list[Sight]:
    """One picture's sights; `rest` holds the landmarks' anatomical places at rest."""
    moved = skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)[joints]
    with_turn = camera.rotation @ moved[:, :3, :3]
    world = np.einsum("nij,nj->ni", moved[:, :3, :3], rest) + moved[:, :3, 3]
    seen = world @ camera.rotation.T + camera.translation
    pixels, _ = camera.project(world)
    sights = []
    for n, place in enumerate(seen):
        onto_plane = np.concatenate([np.eye(2), -(place[:2] / place[2])[:, None]], axis=1)
        metres_a_px = place[2] / camera.focal_px
        off = (person.pixels[n] - pixels[n]) * metres_a_px
        sights.append((onto_plane @ with_turn[n], off, float(person.visibility[n])))
    return sights


def landmarks_of(skeleton: Skeleton, marks: BodyLandmarks) -> Float[Array, "33 3"]:
    """The landmarks' anatomical places on the body with that skeleton, at rest, m."""
    model, shape = load_body_model(), shape_of(skeleton)
    pelvis = model.rest_joints[0] + model.joint_directions[0] @ shape
    return marks.rest + marks.directions @ shape + skeleton.rest_joints[0] - pelvis


def shape_of(skeleton: Skeleton) -> Float[Array, "B"]:
    """The body model's shape whose rest joints lie about the pelvis as the skeleton's do."""
    model = load_body_model()
    directions = model.joint_directions - model.joint_directions[:1]
    directions = directions.reshape(-1, model.shape_count)
    places = [rest - rest[:1] for rest in (skeleton.rest_joints, model.rest_joints)]
    wanted = (places[0] - places[1]).ravel()
    return np.linalg.lstsq(directions, wanted, rcond=None)[0]


def _median_mm(sights: list[Sight], offset: Float[Array, "3"]) -> float:
    return 1e3 * float(np.median([np.linalg.norm(b - a @ offset) for a, b, _ in sights]))


if __name__ == "__main__":
    main()
