"""The report: shares that are right for known people, and advice that follows from them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from capture.captured import CapturedClip
from capture.quality import SIDES, judge, sharpness, side_shares
from scene.camera import orbit_camera
from scene.motion import Motion
from tests.capture.people import JOINT, body, camera, picture, seen_by, standing

FRAMES = 16
SIDE, LEG = ("left", "right"), ("hip", "knee", "ankle", "foot")


def _seen(motion: Motion) -> CapturedClip:
    view = camera()
    people = [seen_by(view, body(), motion.pose(i)) for i in range(len(motion))]
    rng = np.random.default_rng(0)
    images = []
    for person in people:
        image = picture(person)
        noise = rng.integers(-40, 40, image.shape[:2])[..., None]
        images.append(np.clip(image + noise, 0, 255).astype(np.uint8))
    return CapturedClip(
        images=images,
        masks=[p.mask for p in people],
        camera=view,
        body=body(),
        motion=motion,
        landmark_error_px=np.ones((len(motion), 33)),
        frames_lost=0,
        takes=1,
        legs_seen=True,
    )


@pytest.fixture(scope="module")
def turning() -> CapturedClip:
    return _seen(standing(FRAMES, turn_rad=2.0 * np.pi * (FRAMES - 1) / FRAMES))


def test_a_full_turn_covers_every_side(turning):
    quality = judge(turning)
    assert sum(quality.coverage.values()) == pytest.approx(1.0, abs=0.01)
    for side in SIDES:
        assert quality.coverage[side] == pytest.approx(0.25, abs=0.07)
    assert quality.advice == ("Nothing needs to be filmed again.",)


def test_a_person_who_never_turns_is_told_to():
    quality = judge(_seen(standing(8)))
    assert quality.coverage["front"] == 1.0
    assert "left, back, right" in quality.advice[0]
    assert "turn once" in quality.advice[0]


@pytest.mark.parametrize(
    ("azimuth", "side"), [(0.0, "front"), (0.5, "left"), (1.0, "back"), (-0.5, "right")]
)
def test_the_side_seen_is_the_one_that_faces_the_camera(azimuth, side):
    view = orbit_camera((0.0, 0.9, 0.0), 3.0, azimuth * np.pi, 0.1, 64, 64)
    assert side_shares(standing(3), view)[side] == 1.0


def test_a_true_fit_agrees_with_its_mask(turning):
    quality = judge(turning)
    assert quality.mask_overlap > 0.99
    assert quality.joints_in_mask > 0.95
    assert quality.landmark_error_px == 1.0
    assert quality.person_px > 150


def test_a_wrong_fit_does_not(turning):
    moved = replace(
        turning.motion, root_translation=turning.motion.root_translation + np.array([0.4, 0.0, 0.0])
    )
    quality = judge(replace(turning, motion=moved))
    assert quality.mask_overlap < 0.5
    assert any("hard to follow" in line for line in quality.advice)


def test_blur_lowers_the_sharpness(turning):
    image, mask = turning.images[0], turning.masks[0]
    blurred = cv2.GaussianBlur(image, (0, 0), 3.0)
    assert sharpness(blurred, mask) < 0.1 * sharpness(image, mask)
    soft = [cv2.GaussianBlur(i, (0, 0), 3.0) for i in turning.images]
    assert any("blurred" in line for line in judge(replace(turning, images=soft)).advice)


def test_losses_cuts_and_missing_legs_are_told(turning):
    quality = judge(replace(turning, frames_lost=8, takes=3, legs_seen=False))
    text = " ".join(quality.advice)
    assert "lost in 8 of 24 frames" in text
    assert "3 takes" in text
    assert "upper body" in text


def test_so_many_recordings_are_as_many_takes(turning):
    cut = replace(turning, takes=3)
    assert not any("jumps" in line for line in judge(cut, recordings=3).advice)
    assert any("jumps (3 takes)" in line for line in judge(cut, recordings=2).advice)
    assert {name: verdict for name, _, verdict in judge(cut, 3).rows()}["Takes"] == "good"


def test_a_face_close_to_the_camera_is_not_hard_to_follow(turning):
    """Its legs are not in the picture, and what it is off by is as much larger as it is."""
    close = np.arange(FRAMES) < FRAMES // 4
    places = turning.motion.root_translation + close[:, None] * np.array([0.0, -0.6, 1.6])
    confidence = turning.motion.confidence.copy()
    legs = [JOINT[f"{side}_{leg}"] for side in SIDE for leg in LEG]
    confidence[: FRAMES // 4, legs] = 0.0
    motion = replace(turning.motion, root_translation=places, confidence=confidence)
    errors = np.where(close[:, None], 4.0, 1.0) * turning.landmark_error_px
    quality = judge(replace(turning, motion=motion, landmark_error_px=errors))
    assert quality.weak_s == ()
    assert quality.landmark_error_px == pytest.approx(1.0, rel=0.25)


def test_the_report_is_plain_json(turning):
    import json

    stored = json.loads(json.dumps(judge(turning).as_json()))
    assert stored["frames_used"] == FRAMES
    assert set(stored["coverage"]) == set(SIDES)


def test_the_error_is_told_in_millimetres_too(turning):
    """A pixel at the pelvis' depth is depth / focal metres wide: about 2.2 m over 222 px."""
    quality = judge(turning)
    pelvis = turning.body.skeleton.rest_joints[0]
    depth_m = turning.camera.project(pelvis)[1]
    expected = 1e3 * float(depth_m) / turning.camera.intrinsics[0, 0]
    assert quality.landmark_error_mm == pytest.approx(expected, abs=0.06)
    assert 5.0 < quality.landmark_error_mm < 15.0


def test_weak_frames_are_told_by_their_time(turning):
    motion = turning.motion
    confidence = np.ones_like(motion.confidence)
    confidence[6:13] = 0.5
    confidence[2] = 0.1  # a single frame is no stretch of time
    seldom = Motion(motion.times_s * 4.0, motion.joint_angles, motion.root_translation, confidence)
    quality = judge(replace(turning, motion=seldom))
    assert len(quality.frame_confidence) == FRAMES
    assert quality.frame_confidence[6] == 0.5
    assert quality.weak_s == ((round(6 * 4 / 30, 2), round(12 * 4 / 30, 2)),)
    assert any("hard to follow at 0.8-1.6 s" in line for line in quality.advice)


def test_frames_that_miss_their_landmarks_are_weak(turning):
    error = turning.landmark_error_px.copy()
    error[6:11] = 4.0
    slow = Motion(
        turning.motion.times_s * 4.0,
        turning.motion.joint_angles,
        turning.motion.root_translation,
        turning.motion.confidence,
    )
    quality = judge(replace(turning, motion=slow, landmark_error_px=error))
    assert quality.weak_s == ((round(6 * 4 / 30, 2), round(10 * 4 / 30, 2)),)


def test_the_table_says_what_is_good_and_what_is_not(turning):
    rows = {what: (value, verdict) for what, value, verdict in judge(turning).rows()}
    assert rows["Sides"][1] == "all round"
    assert rows["Landmarks"][1] == "good"
    assert rows["Frames"] == (f"{FRAMES} of {FRAMES}", "good")
    poor = judge(replace(_seen(standing(8)), frames_lost=8, takes=2, legs_seen=False))
    rows = {what: (value, verdict) for what, value, verdict in poor.rows()}
    assert rows["Sides"][1] == "not seen: left, back, right"
    assert rows["Frames"] == ("8 of 16", "poor")
    assert rows["Takes"] == ("2", "cuts")
    assert rows["Legs"] == ("not seen", "poor")
