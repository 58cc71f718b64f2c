"""The frames that models of real people are judged on, each with its camera and the pose given.

Those of the training clip that training saw (`own_views`, in the poses that training left), later
frames of it (`later_frames`), other clips of the person (`other_clips`) and other calibrated
cameras (`other_cameras`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.real.calibration import CalibratedCamera, in_capture, read_calibration
from benchmarks.real.cases import Case
from benchmarks.real.filmed import FilmedClip
from benchmarks.real.judge import TestFrame
from benchmarks.real.ruler import Ruler
from capture.sources.video import read_video
from renderer.performer_model import PerformerModel
from scene.camera import Camera
from scene.motion import Pose
from scene.skeleton import JOINT_NAMES, Skeleton

OWN_VIEWS = "own_views"
_SCALES = np.linspace(0.8, 1.25, 19)
_TRUNK = tuple(
    JOINT_NAMES.index(name) for name in ("pelvis", "neck", "left_shoulder", "right_shoulder")
)


def test_frames(
    case: Case,
    clips: dict[str, FilmedClip],
    model: PerformerModel,
    trained: set[int],
    footage: Path,
) -> Iterator[TestFrame]:
    clip = clips[case.trained]
    last = case.trained_share * (len(clip.footage.images) - 1)

    def pose(index: int) -> Pose:
        if index > last:
            return clip.pose(index)
        return model.motion.pose_at(float(clip.footage.times_s[index]))

    for index in clip.ruler.indices:
        if index in trained:
            yield test_frame(clip, OWN_VIEWS, index, clip.camera, pose(index))
        elif index > last:
            yield test_frame(clip, "later_frames", index, clip.camera, pose(index))
    for name in case.other_clips:
        other = clips[name]
        retarget = Retarget.between(other, model)
        camera = retarget.camera(other.camera)
        for index in other.ruler.indices:
            given = retarget.pose(other.pose(index))
            yield test_frame(other, "other_clips", index, camera, given)
    if case.calibration is not None:
        yield from other_cameras(case, clip, model, pose, footage)


def other_cameras(
    case: Case, clip: FilmedClip, model: PerformerModel, pose: Callable[[int], Pose], footage: Path
) -> Iterator[TestFrame]:
    """In the one scale of the clip that fits all their silhouettes best: one camera can't know."""
    assert case.calibration is not None
    calibration = footage / case.calibration
    trained = read_calibration(calibration, case.trained)
    views: list[tuple[CalibratedCamera, TestFrame]] = []
    for name in case.other_cameras:
        ruler, other = Ruler.read(name), read_calibration(calibration, name)
        film_ = read_video(ruler.require_footage(footage), max_frames=100_000, max_side=4096)
        for index in ruler.indices:
            face, hands = ruler.face(index), ruler.hands(index)
            frame = TestFrame(
                "other_cameras",
                name,
                index,
                other.undistorted(film_.images[index]),
                other.undistorted(ruler.mask(index)),
                other.undistorted(ruler.hidden(index)),
                None if face is None else other.undistorted_points(face),
                tuple(other.undistorted_points(hand) for hand in hands),
                in_capture(clip.camera, trained, other, 1.0, film_.source_size),
                pose(index),
            )
            views.append((other, frame))

    def placed(scale: float) -> list[TestFrame]:
        return [
            replace(
                frame,
                camera=in_capture(
                    clip.camera, trained, other, scale, (frame.camera.width, frame.camera.height)
                ),
            )
            for other, frame in views
        ]

    yield from max(map(placed, _SCALES), key=lambda frames: _overlap(model, frames))


def _overlap(model: PerformerModel, frames: list[TestFrame]) -> float:
    overlaps = []
    for frame in frames[::2]:
        inside = model.render(frame.camera, frame.pose)[..., 3] > 0.5
        person = frame.mask > 0.5
        overlaps.append((inside & person).sum() / max((inside | person).sum(), 1))
    return float(np.mean(overlaps))


def test_frame(clip: FilmedClip, group: str, index: int, camera: Camera, pose: Pose) -> TestFrame:
    ruler = clip.ruler
    return TestFrame(
        group,
        ruler.folder.name,
        index,
        clip.footage.images[index],
        ruler.mask(index),
        ruler.hidden(index),
        ruler.face(index),
        tuple(ruler.hands(index)),
        camera,
        pose,
    )


@dataclass(frozen=True, eq=False)
class Retarget:
    """Brings another clip of a person to the size of their model."""

    skeleton: Skeleton
    """Of the clip."""
    model: PerformerModel
    scale: float

    @classmethod
    def between(cls, clip: FilmedClip, model: PerformerModel) -> Retarget:
        """From the world of `clip` to that of `model`."""
        skeleton = clip.sequence.body.skeleton
        return cls(skeleton, model, _trunk_m(model.skeleton) / _trunk_m(skeleton))

    def camera(self, camera: Camera) -> Camera:
        """A world so many times as large gives the same picture when the camera is as much
        farther."""
        moved = [camera.rotation, self.scale * camera.translation[:, None]]
        return replace(camera, world_to_camera=np.concatenate(moved, axis=1))

    def pose(self, pose: Pose) -> Pose:
        """The pose of the other body, with the pelvis in the same place."""
        pelvis = self.scale * (self.skeleton.rest_joints[0] + pose.root_translation)
        return replace(pose, root_translation=pelvis - self.model.skeleton.rest_joints[0])


def _trunk_m(skeleton: Skeleton) -> float:
    joints = skeleton.rest_joints[list(_TRUNK)]
    return float(np.linalg.norm(joints - joints.mean(axis=0), axis=1).mean())
