"""A quick corner of `metanerf bench live-look` on a lifelike performer."""

from __future__ import annotations

import json
from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from benchmarks.lifelike_look import measure
from benchmarks.lifelike_look import performances as shown
from benchmarks.lifelike_look.performances import Performance, beside, performances, trained_clip
from benchmarks.lifelike_look.sheet import draw_sheet
from benchmarks.lifelike_look.webcam import GivenTruth, SeenPicture, SyntheticWebcam
from capture.studio.lifelike.performer import DressedPerformer, make_lifelike_performer
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from renderer.evaluation.lpips import PACKAGED_BACKBONE, Lpips
from renderer.training import train
from scene.skeleton import JOINT_NAMES, Skeleton
from services.joining.finder import PersonFinder
from tests.benchmarks.real.quick import networks
from tests.shared_data import shared_data


@pytest.fixture(scope="module")
def performer() -> DressedPerformer:
    assets = shared_data("human-assets")
    return make_lifelike_performer(LIFELIKE_PERFORMERS["hazel"], assets, expressive=True)


@pytest.fixture(scope="module")
def shown_by(performer: DressedPerformer) -> list[Performance]:
    """At every other picture: an arm that reaches for a place is solved pose by pose."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shown, "PLAYED_HZ", 0.5 * shown.PLAYED_HZ)
        return performances(performer)


class FilmedOnce(SyntheticWebcam):
    """A webcam whose pictures are looked at more than once."""

    _kept: list[SeenPicture] | None = None

    def pictures(self, skeleton: Skeleton) -> Iterator[SeenPicture]:
        if self._kept is None:
            self._kept = list(super().pictures(skeleton))
        return iter(self._kept)


def test_a_hand_crosses_the_chest_and_a_face_does_what_the_clip_did_not_hold(performer, shown_by):
    hand, face, *by_a_lamp = shown_by
    skeleton, motion = performer.body.skeleton, hand.motion
    joints = skeleton.joint_transforms(motion.joint_angles, motion.root_translation)[..., :3, 3]
    off = joints[:, JOINT_NAMES.index("right_wrist")] - joints[:, JOINT_NAMES.index("spine3")]
    assert off[:, 0].min() < -0.15
    assert off[:, 0].max() > 0.03
    assert off[:, 2].min() > 0.15
    assert face.motion.expressions.max(axis=0)[:5].min() > 0.8
    assert [one.light is None for one in (hand, face, *by_a_lamp)] == [True, True, False, False]


def test_a_camera_is_carried_round_the_chest(performer, shown_by):
    one, chest = shown_by[0], JOINT_NAMES.index("spine3")
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
    monkeypatch.setattr(shown, "FRAMES", 6)
    monkeypatch.setattr(shown, "SIZE_PX", 96)
    monkeypatch.setattr(shown, "WEBCAM_PX", (320, 240))
    monkeypatch.setattr(shown, "SECONDS", 0.5)
    monkeypatch.setattr(measure, "FIRST", 3)
    monkeypatch.setattr(measure, "BESIDE_DEG", (0.0, 20.0))
    monkeypatch.setattr(measure, "BEHIND_DEG", (180.0,))
    model = train(
        trained_clip(performer, "hazel", tmp_path / "clip"), iterations=60, clock=lambda: 0.0
    ).splats
    assert model is not None
    one, files = performances(performer)[0], networks()
    with PersonFinder(files.pose, files.face, files.hand) as finder:
        webcam = FilmedOnce(one, finder, GivenTruth(pose=True))
        seen = list(webcam.pictures(model.skeleton))
        assert [each.number for each in seen] == list(range(0, 10, 2)), "the page sends every other"
        assert seen[3].picture.pose.joint_angles == pytest.approx(one.motion.joint_angles[6])
        looked_at = list(measure.played(one, webcam, model, []))
    assert [each.number for each in looked_at] == [6, 8]
    figures = measure.judged(looked_at, model, Lpips(PACKAGED_BACKBONE))
    json.dumps(figures, allow_nan=False)
    assert figures["frames"] == 1
    assert set(figures) == {"frames", "0", "20", "180"}
    for degrees in (0.0, 20.0, 180.0):
        for figure in figures[f"{degrees:g}"].values():
            assert figure["body"] > 0.0
            assert ("flicker" in figure) == (degrees in measure.FLICKER_DEG)
    beside_0, behind = figures["0"], figures["180"]
    assert beside_0["live"]["body_psnr"] > beside_0["model"]["body_psnr"] - 1.0
    assert behind["live"]["body"] == pytest.approx(behind["model"]["body"], rel=0.2)
    sheet = tmp_path / "sheet.jpg"
    draw_sheet(sheet, model, [looked_at])
    drawn = cv2.imread(str(sheet))
    assert drawn is not None
    assert np.ptp(drawn) > 200
