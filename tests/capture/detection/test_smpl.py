"""Plug-ins: another estimator, another body model, SMPL parameters: all through the same door."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from capture.body.model import BodyModel, LinearBodyModel, load_body_model
from capture.detection.landmarks import Landmarks, PoseEstimator
from capture.detection.smpl import landmarks_of_pose
from capture.pipeline import CaptureOptions, capture_clip
from capture.sources.readers import open_folder, write_humannerf
from capture.storage import open_sequence, write_sequence
from scene.arrays import Array
from scene.errors import InvalidInput
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import Frame, PoseTrust, Sequence
from tests.capture.people import JOINT, body, camera, encoded, picture, seen_by, standing

FRAMES = 9


def test_landmarks_of_a_pose_are_those_that_an_estimator_would_see():
    pose = standing(4, turn_rad=0.5).pose(2)
    truth = seen_by(camera(), body(), pose)
    found = landmarks_of_pose(pose, body(), camera(), truth.mask)
    np.testing.assert_allclose(found.pixels, truth.pixels, atol=0.01)
    np.testing.assert_allclose(found.world, truth.world, atol=1e-4)
    assert (found.visibility == 1.0).all()


def test_a_mask_must_be_as_large_as_the_picture():
    with pytest.raises(InvalidInput, match="mask must be 256 x 256; got 8 x 8"):
        landmarks_of_pose(standing(1).pose(0), body(), camera(), np.zeros((8, 8)))


@dataclass
class Regressor:
    """A tiny `PoseEstimator` that gives poses, as SPIN does; it reads them off `scenery`."""

    sequence: Sequence

    def detect(self, image: Array) -> list[Landmarks]:
        """The person of the frame and window that the first pixel tells."""
        x, y, frame = (int(level) for level in image[0, 0])
        truth = self.sequence.frame(frame)
        found = landmarks_of_pose(
            truth.pose, self.sequence.body, truth.camera, np.asarray(truth.mask)
        )
        height, width = image.shape[:2]
        window = found.mask[y : y + height, x : x + width]
        return [replace(found, pixels=found.pixels - [x, y], mask=window)]


def scenery(frame: int, size: int = 256) -> Array:
    """A room whose every pixel tells its column, its row and the frame."""
    y, x = np.mgrid[:size, :size]
    return np.stack([x, y, np.full_like(x, frame)], axis=2).astype(np.uint8)


@pytest.fixture(scope="module")
def theirs(tmp_path_factory) -> Sequence:
    """A sequence in HumanNeRF's layout, read back: SMPL's parameters and joints."""
    folder, motion = tmp_path_factory.mktemp("theirs"), standing(FRAMES, turn_rad=0.5)
    people = [seen_by(camera(), body(), motion.pose(i)) for i in range(FRAMES)]
    frames = [
        Frame(
            picture(person).astype(np.float32) / 255.0 * person.mask[..., None],
            person.mask,
            camera(),
            motion.pose(i),
        )
        for i, person in enumerate(people)
    ]
    write_sequence(
        folder / "ours",
        person="p",
        frames_per_second=30.0,
        body=body(),
        train=frames,
        source="test",
        pose_trust=PoseTrust.EXACT,
    )
    write_humannerf(open_sequence(folder / "ours"), folder / "humannerf")
    return open_folder(folder / "humannerf")


@pytest.mark.usefixtures("fewer_steps")
def test_another_estimator_and_another_body_model_make_a_sequence(theirs, tmp_path):
    clip = tmp_path / "frames"
    clip.mkdir()
    for index in range(FRAMES):
        frame = theirs.frame(index)
        seen = np.where(
            np.asarray(frame.mask)[..., None] > 0.5, frame.image * 255.0, scenery(index)
        )
        (clip / f"{index:03d}.png").write_bytes(encoded(seen.astype(np.uint8)))
    estimator: PoseEstimator = Regressor(theirs)
    model: BodyModel = dwarf()
    options = CaptureOptions(person="p", estimator=estimator, body_model=model)
    capture_clip(clip, tmp_path / "seq", options)
    found = open_sequence(tmp_path / "seq")
    assert len(found.train) == FRAMES
    assert found.body.skeleton.height_m < 0.96 * body().skeleton.height_m
    ours, truth = found.motion.joint_angles, theirs.motion.joint_angles
    for name in ("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_knee"):
        turns = [axis_angle_to_matrix(angles[:, JOINT[name]]) for angles in (ours, truth)]
        gaps = matrix_to_axis_angle(np.swapaxes(turns[0], -1, -2) @ turns[1])
        missed = np.linalg.norm(gaps, axis=-1)
        assert max(missed[0], missed[-1]) < 0.35, name
        assert missed.mean() < 0.3, name


def dwarf() -> LinearBodyModel:
    """A second body model: ours, smaller by a tenth, with height as its only shape number."""
    model = load_body_model()
    return LinearBodyModel(
        0.9 * model.rest_vertices,
        0.9 * model.rest_joints,
        model.vertex_directions[..., :1],
        model.joint_directions[..., :1],
        model.faces,
        model.blend_weights,
    )
