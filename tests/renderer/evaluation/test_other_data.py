"""Data that a model was not trained on: its own poses, in the model's size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.evaluation.evaluate import evaluate
from renderer.evaluation.other_data import on_body_of, size_ratio
from scene import Skeleton
from scene.body import Body
from scene.errors import InvalidInput
from scene.motion import Motion
from scene.sequence import Sequence
from tests.renderer.evaluation.test_evaluate import Painted
from tests.renderer.field.performer import body, sequence


def _larger(clip: Sequence, scale: float) -> Sequence:
    """The same pictures of somebody `scale` times as large, as much farther away."""
    resized = on_body_of(_Sized(scale), clip)
    own = clip.body
    assert own.rest_vertices is not None
    larger = Body(
        _skeleton(scale),
        scale * own.rest_vertices,
        own.faces,
        own.blend_weights,
        own.expression_directions,
    )
    motion = Motion.from_poses([resized.train.pose(i) for i in range(len(resized.train))])
    return replace(resized, body=larger, motion=motion, data_hash="1" * 64)


def _skeleton(scale: float) -> Skeleton:
    return Skeleton(scale * body().skeleton.rest_joints)


class _Sized(Painted):
    def __init__(self, scale: float) -> None:
        super().__init__()
        self._scale = scale

    @property
    def skeleton(self) -> Skeleton:
        return _skeleton(self._scale)


def test_pictures_stay_where_they_are_in_a_world_of_another_size():
    clip = sequence()
    larger = on_body_of(_Sized(1.3), clip)
    for index in range(len(clip.train)):
        before, after = clip.train, larger.train
        joints = clip.body.skeleton.joint_transforms(
            before.pose(index).joint_angles, before.pose(index).root_translation
        )[:, :3, 3]
        moved = _skeleton(1.3).joint_transforms(
            after.pose(index).joint_angles, after.pose(index).root_translation
        )[:, :3, 3]
        np.testing.assert_allclose(
            after.camera(index).project(moved)[0],
            before.camera(index).project(joints)[0],
            atol=1e-6,
        )


def test_other_data_is_judged_in_its_own_poses_and_says_so():
    result = evaluate(Painted(), _larger(sequence(), 1.2))
    assert "training_view" not in result["per_view"]
    # painted by the model's own body, in the model's size: the very pictures
    assert result["psnr"]["other_data"]["body_crop"] > 35.0
    assert result["conditions"]["trained_on_this_data"] is False
    assert evaluate(Painted(), sequence())["conditions"]["trained_on_this_data"] is True


def test_its_poses_are_its_own_not_those_that_the_model_has_for_that_time():
    clip = replace(sequence(), data_hash="2" * 64)
    pose = clip.train.pose(0)
    turned = replace(pose, joint_angles=pose.joint_angles + np.eye(24, 3) * 0.4)
    drawn = []

    class Watched(Painted):
        def render(self, camera, pose):
            drawn.append(pose)
            return super().render(camera, pose)

    class Turned:
        def __getattr__(self, name):
            return getattr(clip.train, name)

        def __len__(self):
            return len(clip.train)

        def pose(self, index):
            return turned

    evaluate(Watched(), replace(clip, train=Turned(), test={}))
    np.testing.assert_allclose(drawn[0].joint_angles, turned.joint_angles)


def test_size_ratio_of_two_sizes_of_one_person():
    assert size_ratio(_skeleton(1.1), _skeleton(1.0)) == pytest.approx(1.1)


def test_another_person_is_refused_with_what_to_do():
    rest = body().skeleton.rest_joints.copy()
    rest[:, 1] *= 1.6  # twice as slender
    with pytest.raises(InvalidInput, match=r"same person.*differ in proportion.*another clip"):
        size_ratio(Skeleton(rest), body().skeleton)
