"""A webcam's picture counts inside its person's outline alone."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.live_look.picture import WebcamPicture
from scene.camera import orbit_camera
from scene.motion import Pose


@pytest.mark.parametrize("rim_px", [1, 2, 3])
def test_what_is_near_the_outline_is_not_known(rim_px: int):
    matte = np.zeros((60, 60), np.uint8)
    matte[20:, 10:40] = 255
    camera = orbit_camera((0.0, 1.0, 0.0), 2.0, 0.0, 0.0, 60, 60)
    picture = WebcamPicture(np.zeros((60, 60, 3), np.uint8), matte, camera, Pose.rest())
    expected = np.zeros((60, 60), np.float32)
    # the picture's own edge, below, is no outline
    expected[20 + rim_px :, 10 + rim_px : 40 - rim_px] = 1.0
    np.testing.assert_array_equal(picture.known(rim_px), expected)
