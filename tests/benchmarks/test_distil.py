"""A model drawn from all round is a clip to learn from."""

from __future__ import annotations

import numpy as np

from benchmarks.distil import draw_round, joined, of
from scene.rotations import axis_angle_to_matrix
from tests.renderer.studio import make_model, make_sequence


def test_drawn_frames_show_the_model_from_elsewhere_at_the_same_distance():
    clip, model = make_sequence(), make_model()
    drawn = draw_round(model, clip, np.random.default_rng(0), views=5)
    given = clip.train.camera(0)
    for index in range(5):
        camera = drawn.camera(index)
        assert not np.allclose(camera.world_to_camera, given.world_to_camera, atol=0.05)
        np.testing.assert_array_equal(camera.intrinsics, given.intrinsics)
        rotation = camera.rotation
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        assert drawn.mask(index).max() > 0.9
        # whoever stood in the picture's middle still does
        columns = np.flatnonzero(drawn.mask(index).max(axis=0) > 0.5)
        assert abs(columns.mean() - 0.5 * camera.width) < 0.25 * camera.width


def test_clips_of_drawn_frames_keep_what_was_known():
    clip = make_sequence()
    drawn = draw_round(make_model(), clip, np.random.default_rng(0), views=3)
    both = of(joined(clip, drawn), clip)
    assert len(both.train) == len(both.motion) == len(clip.train) + 3
    np.testing.assert_array_equal(both.train.image(0), clip.train.image(0))
    turn = axis_angle_to_matrix(both.motion.joint_angles[1, 0])
    np.testing.assert_allclose(turn, axis_angle_to_matrix(clip.motion.joint_angles[1, 0]))
