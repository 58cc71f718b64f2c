"""Poses, bodies and cameras that are off; the pictures stay as they are, but for a rolling camera.

Poses count as estimated, so training may refine them.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from benchmarks.covered_torso import hands_before_chest
from benchmarks.stability.material import Material, Subject
from benchmarks.stability.pose_errors import geodesic_deg
from benchmarks.stability.precision import PRECISIONS
from capture.studio.garments import drape
from scene.arrays import Array, Float
from scene.body import Body
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import Frame
from scene.skeleton import JOINT_NAMES, Skeleton

CORRELATION_S = 0.5
"""For how long noise that lasts is about the same, as the errors of a capture are."""
_DRIFT = np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0)
"""Sideways and in depth alike."""
_ROLLS = 3.0
"""Swings of a rolling camera in a clip."""
_SHUTTER_SAMPLES = 5
_ARMS = [
    JOINT_NAMES.index(f"{side}_{part}")
    for side in ("left", "right")
    for part in ("shoulder", "elbow", "wrist")
]


def noisy(motion: Motion, noise_deg: float, rng: np.random.Generator, *, lasting: bool) -> Motion:
    """`motion` with noise about each axis of each joint: independent from frame to frame, or
    `lasting`, wandering as a real capture's does."""
    noise = rng.normal(size=motion.joint_angles.shape)
    if lasting:
        gap = motion.times_s[:, None] - motion.times_s[None, :]
        kernel = np.exp(-0.5 * (gap / CORRELATION_S) ** 2)
        kernel /= np.sqrt((kernel**2).sum(axis=1, keepdims=True))
        noise = np.einsum("fg,gkx->fkx", kernel, noise)
    rotations = axis_angle_to_matrix(np.deg2rad(noise_deg) * noise)
    turned = rotations @ axis_angle_to_matrix(motion.joint_angles)
    return replace(motion, joint_angles=matrix_to_axis_angle(turned))


def pose_noise(subject: Subject, degrees: float, rng: np.random.Generator) -> Material:
    """Each frame its own."""
    return _reposed(subject, noisy(subject.material.true_motion, degrees, rng, lasting=False))


def lasting_pose_noise(subject: Subject, degrees: float, rng: np.random.Generator) -> Material:
    """About the same for half a second."""
    return _reposed(subject, noisy(subject.material.true_motion, degrees, rng, lasting=True))


def root_drift(subject: Subject, metres: float, rng: np.random.Generator) -> Material:
    """The root wanders off steadily, by `metres` at the end."""
    del rng
    motion = subject.material.true_motion
    share = np.linspace(0.0, 1.0, len(motion))[:, None]
    return _reposed(
        subject, replace(motion, root_translation=motion.root_translation + metres * share * _DRIFT)
    )


def body_scale(subject: Subject, percent: float, rng: np.random.Generator) -> Material:
    """A body that is too large; the pelvis is where it should be."""
    del rng
    scale, material = 1.0 + 0.01 * percent, subject.material
    body = material.body
    shift = (1.0 - scale) * body.skeleton.rest_joints[0]

    def moved(frame: Frame) -> Frame:
        root = frame.pose.root_translation + shift
        return replace(frame, pose=replace(frame.pose, root_translation=root))

    return replace(material.everywhere(moved), body=_scaled(body, scale))


def focal_length(subject: Subject, percent: float, rng: np.random.Generator) -> Material:
    """A focal length that is off by `percent`, the person placed where they then seem to be."""
    del rng
    factor, material = 1.0 + 0.01 * percent, subject.material
    pelvis = material.body.skeleton.rest_joints[0]

    def wrong(frame: Frame) -> Frame:
        camera = frame.camera
        seen = camera.rotation @ (pelvis + frame.pose.root_translation) + camera.translation
        seen[2] *= factor
        root = camera.rotation.T @ (seen - camera.translation) - pelvis
        k = camera.intrinsics.copy()
        k[[0, 1], [0, 1]] *= factor
        return replace(
            frame,
            camera=replace(camera, intrinsics=k),
            pose=replace(frame.pose, root_translation=root),
        )

    return material.with_train(map(wrong, material.train))


def rolling_camera(subject: Subject, degrees: float, rng: np.random.Generator) -> Material:
    """A camera in somebody's hand, which rolls to and fro, counts as still."""
    del rng
    frames = subject.material.train
    swing = degrees * np.sin(2.0 * np.pi * _ROLLS * np.arange(len(frames)) / len(frames))

    def rolled(frame: Frame, angle_deg: float) -> Frame:
        x, y = frame.camera.intrinsics[:2, 2]
        turn = cv2.getRotationMatrix2D((float(x) - 0.5, float(y) - 0.5), angle_deg, 1.0)
        size = (frame.camera.width, frame.camera.height)
        image, mask = (cv2.warpAffine(part, turn, size) for part in (frame.image, frame.mask))
        return replace(frame, image=image, mask=mask)

    return subject.material.with_train(
        rolled(frame, float(angle)) for frame, angle in zip(frames, swing, strict=True)
    )


def motion_blur(subject: Subject, shutter: float, rng: np.random.Generator) -> Material:
    """A shutter that is open for a share of a frame's time."""
    del rng
    assert subject.stage is not None
    stage, material = subject.stage, subject.material
    open_s = shutter / material.frames_per_second

    def blurred(frame: Frame) -> Frame:
        times = frame.pose.time_s + open_s * np.linspace(-0.5, 0.5, _SHUTTER_SAMPLES)
        poses = [material.true_motion.pose_at(float(time)) for time in times]
        seen = [stage.frame(pose, frame.camera) for pose in poses]
        image = np.mean([one.image for one in seen], axis=0)
        return replace(frame, image=image, mask=np.mean([one.mask for one in seen], axis=0))

    return material.with_train(map(blurred, material.train))


def own_arms(subject: Subject, share: float, rng: np.random.Generator) -> Material:
    """Both hands before the chest in a share of the frames, which never show what is behind."""
    assert subject.stage is not None
    stage, material = subject.stage, subject.material
    covering = hands_before_chest(material.body.skeleton, len(material.train))
    covered = _some(len(material.train), share, rng)

    def filmed(index: int, frame: Frame) -> Frame:
        if index not in covered:
            return frame
        angles = frame.pose.joint_angles.copy()
        angles[_ARMS] = covering.joint_angles[index, _ARMS]
        return stage.frame(replace(frame.pose, joint_angles=angles), frame.camera)

    frames = tuple(filmed(index, frame) for index, frame in enumerate(material.train))
    motion = Motion.from_poses([frame.pose for frame in frames])
    return replace(material, train=frames, true_motion=motion)


def far_poses(subject: Subject, times: float, rng: np.random.Generator) -> Material:
    """Judged in poses so many times as far from the training set's mean as its own are."""
    del rng
    assert subject.stage is not None
    stage, material = subject.stage, subject.material
    mean = material.true_motion.joint_angles.mean(axis=0)

    def exaggerated(frame: Frame) -> Frame:
        angles = frame.pose.joint_angles.copy()
        angles[1:] = mean[1:] + (1.0 + times) * (angles[1:] - mean[1:])
        return stage.frame(replace(frame.pose, joint_angles=angles), frame.camera)

    return replace(material, judged=tuple(map(exaggerated, material.judged)))


def loose_clothes(subject: Subject, width: float, rng: np.random.Generator) -> Material:
    """A skirt and sleeves `width` times as wide as the studio's, which swing."""
    del rng
    assert subject.stage is not None
    stage, material = subject.stage, subject.material
    garments = tuple(
        replace(garment, rest=_widened(garment.rest, width)) for garment in stage.performer.garments
    )
    cloth = drape(garments, stage.performer.body, material.true_motion)
    return material.everywhere(lambda frame: stage.frame(frame.pose, frame.camera, cloth))


def random_seed(subject: Subject, seed: float, rng: np.random.Generator) -> Material:
    """Another seed of the training, and nothing else."""
    del rng
    return replace(subject.material, seed=int(seed))


def low_precision(subject: Subject, step: float, rng: np.random.Generator) -> Material:
    """The trained model is stored in fewer bits before it is judged."""
    del rng
    return replace(subject.material, precision=PRECISIONS[int(step)])


def joint_mm(motion: Motion, skeleton: Skeleton, truth: Motion, true_skeleton: Skeleton) -> float:
    """Mean distance of the joints from the true ones, of the moments of `motion`, mm."""
    places = [
        body.joint_transforms(
            np.stack([pose.joint_angles for pose in poses]),
            np.stack([pose.root_translation for pose in poses]),
        )[..., :3, 3]
        for body, poses in ((skeleton, _poses(motion)), (true_skeleton, _same(truth, motion)))
    ]
    return 1e3 * float(np.linalg.norm(places[0] - places[1], axis=-1).mean())


def rotation_deg(motion: Motion, truth: Motion) -> float:
    """Mean error of the joints' own rotations, of the moments of `motion`."""
    true = np.stack([pose.joint_angles for pose in _same(truth, motion)])
    one, other = axis_angle_to_matrix(motion.joint_angles), axis_angle_to_matrix(true)
    return float(geodesic_deg(one, other).mean())


def _poses(motion: Motion) -> list[Pose]:
    return [motion.pose(index) for index in range(len(motion))]


def _same(truth: Motion, motion: Motion) -> list[Pose]:
    return [truth.pose_at(float(time)) for time in motion.times_s]


def _reposed(subject: Subject, motion: Motion) -> Material:
    """Trained on what `motion` claims."""
    frames = subject.material.train
    return subject.material.with_train(
        replace(frame, pose=motion.pose(index)) for index, frame in enumerate(frames)
    )


def _scaled(body: Body, scale: float) -> Body:
    vertices, directions = body.rest_vertices, body.expression_directions
    return replace(
        body,
        skeleton=replace(body.skeleton, rest_joints=scale * body.skeleton.rest_joints),
        rest_vertices=None if vertices is None else scale * vertices,
        expression_directions=None if directions is None else scale * directions,
    )


def _widened(rest: Float[Array, "R A 3"], width: float) -> Float[Array, "R A 3"]:
    """Rings of a garment, each wider than the first by `width` times as much as they are."""
    middle = rest.mean(axis=1, keepdims=True)
    spokes = rest - middle
    radius = np.linalg.norm(spokes, axis=-1, keepdims=True)
    wanted = radius[:1] + width * (radius - radius[:1])
    return middle + spokes * (wanted / np.maximum(radius, 1e-9))


def _some(length: int, share: float, rng: np.random.Generator) -> set[int]:
    return set(rng.permutation(length)[: round(share * length)].tolist())
