"""What the benchmark of found expressions films and compares."""

from __future__ import annotations

import numpy as np

from benchmarks.expressions_found import PICTURES, around_a_hand, mean_errors, performances
from capture.body.landmark_names import FACE_LANDMARKS, LANDMARK_NAMES
from scene.expression import GAZE


def test_what_is_performed_differs_from_picture_to_picture():
    poses = performances(np.random.default_rng(1))
    shown = np.array([pose.expression for pose in poses])
    assert len(poses) == PICTURES
    assert (np.ptp(np.delete(shown, GAZE, axis=1), axis=0) > 0.4).all()
    assert len(np.unique(shown[:, GAZE], axis=0)) > 0.9 * PICTURES
    assert not any(pose.joint_angles.any() for pose in poses)


def test_a_hand_is_looked_for_where_it_is_and_the_other_is_not():
    person = around_a_hand("left", np.array([100.0, 80.0]), np.array([130.0, 90.0]))
    seen = [LANDMARK_NAMES[i] for i in np.flatnonzero(person.visibility)]
    assert sorted(seen) == ["left_index", "left_pinky", "left_thumb", "left_wrist"]
    assert np.ptp(person.pixels[:FACE_LANDMARKS], axis=0).max() == 64.0


def test_hands_that_were_never_found_have_no_say_in_the_mean():
    hand = {"found": 30, "joints_deg": 6.0, "fingers_deg": [6.0] * 5}
    gone = {"found": 0, "joints_deg": None, "fingers_deg": None}
    row = {"gaze_deg": 4.0, "gaze_spread_deg": 10.0, "left_hand": hand, "right_hand": gone}
    means = mean_errors([row])
    assert means["finger_joints_deg"] == 6.0
    assert means["hands_found"] == 0.5
