"""A quick corner of `metanerf bench live-look` on a lifelike performer."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.lifelike_look import performances as shown
from benchmarks.lifelike_look.measure import BEHIND_DEG, BESIDE_DEG, FLICKER_DEG, judged, played
from benchmarks.lifelike_look.performances import Performance, beside, performances, trained_clip
from benchmarks.lifelike_look.sheet import draw_sheet
from benchmarks.lifelike_look.webcam import GivenTruth, SyntheticWebcam
from capture.studio.lifelike.performer import DressedPerformer, make_lifelike_performer
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from renderer.evaluation.lpips import PACKAGED_BACKBONE, Lpips
from renderer.training import train
from scene.motion import Motion
from scene.skeleton import JOINT_NAMES
from services.joining.finder import PersonFinder
from tests.benchmarks.real.test_measure import networks
from tests.shared_data import shared_data


@pytest.fixture(scope="module")
def performer() -> DressedPerformer:
    assets = shared_data("human-assets")
    return make_lifelike_performer(LIFELIKE_PERFORMERS["hazel"], assets, expressive=True)


def first(motion: Motion, count: int) -> Motion:
    return replace(
        motion,
        times_s=motion.times_s[:count],
        joint_angles=motion.joint_angles[:count],
        root_translation=motion.root_translation[:count],
        confidence=motion.confidence[:count],
        expressions=motion.expressions[:count],
    )


def test_a_hand_crosses_the_chest_and_a_face_does_what_the_clip_did_not_hold(performer):
    hand, face, *by_a_lamp = performances(performer)
    skeleton, motion = performer.body.skeleton, hand.motion
    joints = skeleton.joint_transforms(motion.joint_angles, motion.root_translation)[..., :3, 3]
    off = joints[:, JOINT_NAMES.index("right_wrist")] - joints[:, JOINT_NAMES.index("spine3")]
    assert off[:, 0].min() < -0.15
    assert off[:, 0].max() > 0.03
    assert off[:, 2].min() > 0.15
    assert face.motion.expressions.max(axis=0)[:5].min() > 0.8
    assert [one.light is None for one in (hand, face, *by_a_lamp)] == [True, True, False, False]


def test_a_camera_is_carried_round_the_chest(performer):
    one, chest = performances(performer)[0], JOINT_NAMES.index("spine3")
    pose, skeleton = one.motion.pose(7), performer.body.skeleton
    place = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)[chest, :3, 3]
    for degrees in (0.0, 40.0, 180.0):
        camera = beside(one.webcam, pose, skeleton, degrees)
        pixel, depth = camera.project(place[None])
        before, far = one.webcam.project(place[None])
        assert pixel == pytest.approx(before, abs=1e-6)
        assert depth == pytest.approx(far)
    to_camera = beside(one.webcam, pose, skeleton, 90.0).position - place
    assert to_camera[0] > 5.0 * abs(to_camera[2]), "at the person's left"


def test_figures_of_each_side_come_of_what_the_webcam_sends(performer, tmp_path, monkeypatch):
    monkeypatch.setattr(shown, "FRAMES", 10)
    monkeypatch.setattr(shown, "SIZE_PX", 160)
    model = train(
        trained_clip(performer, "hazel", tmp_path / "clip"), iterations=120, clock=lambda: 0.0
    ).splats
    assert model is not None
    one, files = performances(performer)[0], networks()
    short = Performance(one.name, performer, first(one.motion, 20), one.webcam)
    with PersonFinder(files.pose, files.face, files.hand) as finder:
        webcam = SyntheticWebcam(short, finder, GivenTruth(pose=True))
        seen = list(webcam.pictures(model.skeleton))
        assert [each.number for each in seen] == list(range(0, 20, 2)), "the page sends every other"
        assert seen[3].picture.pose.joint_angles == pytest.approx(one.motion.joint_angles[6])
        looked_at = list(played(short, webcam, model, []))
    assert [each.number for each in looked_at] == [16, 18]
    figures = judged(looked_at, model, Lpips(PACKAGED_BACKBONE))
    json.dumps(figures, allow_nan=False)
    assert figures["frames"] == 1
    for degrees in (*BESIDE_DEG, *BEHIND_DEG):
        for figure in figures[f"{degrees:g}"].values():
            assert figure["body"] > 0.0
            assert ("flicker" in figure) == (degrees in FLICKER_DEG)
    beside_0, behind = figures["0"], figures["180"]
    assert beside_0["live"]["body_psnr"] > beside_0["model"]["body_psnr"] - 1.0
    assert behind["live"]["body"] == pytest.approx(behind["model"]["body"], rel=0.2)
    sheet = tmp_path / "sheet.jpg"
    draw_sheet(sheet, model, [looked_at])
    drawn = cv2.imread(str(sheet))
    assert drawn is not None
    assert np.ptp(drawn) > 200
