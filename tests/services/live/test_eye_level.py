"""Heads held level: whoever looks down into a webcam looks at the others of a meeting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scene.motion import Motion, Pose
from scene.skeleton import HEAD, JOINT_NAMES
from services.live.eye_level import below_horizon, with_level_gaze
from services.live.motion.live_motion import LiveMotion
from tests.capture.people import body, standing
from tests.services.live.people import seen

NECK = JOINT_NAMES.index("neck")
FRAMES = 40


def bowed(down_deg: float, nod_deg: float = 0.0) -> Motion:
    """Somebody who looks down by so much, and nods about that."""
    motion = standing(FRAMES)
    angles = motion.joint_angles.copy()
    angles[:, [NECK, HEAD]] = 0.0
    nods = nod_deg * np.sin(np.linspace(0.0, 4.0 * np.pi, FRAMES, endpoint=False))
    angles[:, NECK, 0] = np.radians(0.4 * down_deg)
    angles[:, HEAD, 0] = np.radians(0.6 * down_deg + nods)
    return replace(motion, joint_angles=angles)


def looks_below(pose: Pose) -> float:
    """Degrees."""
    joints = body().skeleton.joint_transforms(pose.joint_angles, pose.root_translation)
    return float(np.degrees(below_horizon(joints[HEAD, :3, :3])))


def below(motion: Motion) -> np.ndarray:
    return np.array([looks_below(motion.pose(i)) for i in range(len(motion))])


@pytest.mark.parametrize("down_deg", [22.0, -15.0, 0.0])
def test_a_head_bowed_into_a_webcam_is_level_and_nods_as_before(down_deg):
    filmed = bowed(down_deg, nod_deg=8.0)
    shown = with_level_gaze(body().skeleton, filmed)
    assert below(shown).mean() == pytest.approx(0.0, abs=0.5)
    np.testing.assert_allclose(below(shown), below(filmed) - below(filmed).mean(), atol=1.0)
    others = [joint for joint in range(24) if joint not in (NECK, HEAD)]
    np.testing.assert_array_equal(shown.joint_angles[:, others], filmed.joint_angles[:, others])


def test_whoever_looks_at_their_feet_still_does():
    shown = with_level_gaze(body().skeleton, bowed(60.0))
    assert below(shown).mean() == pytest.approx(35.0, abs=1.0)


def test_a_live_head_is_level_at_once_and_a_nod_is_a_nod():
    live, motion, shown = LiveMotion(body().skeleton), bowed(20.0), []
    for index in range(FRAMES):
        pose = motion.pose(index)
        if 25 <= index < 35:
            nodding = pose.joint_angles.copy()
            nodding[HEAD, 0] += np.radians(25.0)
            pose = replace(pose, joint_angles=nodding)
        live.update(seen(pose, index), pose.time_s)
        at = live.pose_at(pose.time_s)
        assert at is not None
        shown.append(looks_below(at))
    assert abs(np.mean(shown[5:20])) < 4.0
    assert max(shown[28:35]) > np.mean(shown[5:20]) + 12.0
