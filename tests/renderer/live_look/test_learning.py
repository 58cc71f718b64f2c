"""What was kept becomes frames that are learnt from beside the clip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.live_look.frame_keeper import Fitness, KeptFrame, Side
from renderer.live_look.learning import training_frames, with_kept
from renderer.live_look.picture import WebcamPicture
from renderer.training import train
from scene.skeleton import Skeleton
from tests.renderer.clocks import ticking
from tests.renderer.studio import make_sequence

FIT = Fitness(sharpness=200.0, luma=0.4, clipped=0.0, soft=0.05, overlap=0.95, difference=0.03)


def test_a_kept_picture_becomes_a_frame_premultiplied_with_its_camera_and_pose():
    frame = make_sequence(frames=1).frame(0)
    rgb = np.full((*frame.mask.shape, 3), 200, np.uint8)
    matte = (255.0 * frame.mask + 0.5).astype(np.uint8)
    picture = WebcamPicture(rgb, matte, frame.camera, frame.pose)
    (made,) = training_frames([KeptFrame(picture, (Side("head", 60, 0),), FIT)])
    np.testing.assert_allclose(made.mask, frame.mask, atol=0.01)
    expected = made.mask[..., None] * np.float32(200 / 255) * np.ones(3)
    np.testing.assert_allclose(made.image, expected, atol=1e-5)
    assert (made.camera, made.pose) == (frame.camera, frame.pose)


def test_frames_that_the_model_knows_stand_where_its_training_left_them():
    clip = make_sequence(frames=4)
    first, second = (replace(make_sequence(frames=2), data_hash=name) for name in "ab")
    model = train(clip.followed_by(first), iterations=5, clock=ticking()).splats
    assert model is not None
    moved = replace(
        model.motion, root_translation=model.motion.root_translation + np.array([0.05, 0.0, 0.0])
    )
    model = replace(model, motion=moved, skeleton=Skeleton(1.01 * model.skeleton.rest_joints))
    whole = with_kept(clip, [first, second], model)
    assert len(whole.train) == 8
    np.testing.assert_array_equal(whole.motion.root_translation[:6], moved.root_translation)
    assert whole.body.skeleton is model.skeleton
    pelvis = clip.body.skeleton.rest_joints[0] - model.skeleton.rest_joints[0]
    expected = second.motion.root_translation + pelvis
    np.testing.assert_allclose(whole.motion.root_translation[6:], expected)
    unknown = with_kept(clip, [second], model)
    assert unknown.body is clip.body
    np.testing.assert_array_equal(unknown.motion.root_translation[:4], clip.motion.root_translation)
