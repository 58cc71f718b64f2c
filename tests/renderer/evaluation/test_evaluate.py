"""Evaluation on models whose figures are known beforehand."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from renderer.evaluation.evaluate import EvaluatedView, evaluate, side_of_body
from renderer.presets import Preset
from scene import NOVEL_VIEW, UNSEEN_POSE, Camera, Motion, Pose, Skeleton
from tests.renderer.field.performer import Frames, body, paint, pose, sequence, view
from tests.shared_data import shared_data


class Painted:
    """A model that paints the truth, dimmed by `error`."""

    kind = preset = "painted"
    data_hash, splats = "0" * 64, None

    def __init__(self, error: float = 0.0) -> None:
        self._error = error
        self.metrics: dict = {}

    @property
    def skeleton(self) -> Skeleton:
        return body().skeleton

    @property
    def motion(self) -> Motion:
        return sequence().motion

    def render(self, camera: Camera, pose: Pose) -> np.ndarray:
        frame = paint(body(), camera, pose)
        rgb = np.clip(frame.image + np.float32(self._error), 0.0, 1.0)
        return np.concatenate([rgb, frame.mask[..., None]], axis=2).astype(np.float32)

    def filmed_parts(self) -> Painted:
        return self

    def drawn_as(self, preset: Preset) -> Painted:
        return self

    def tensors(self) -> dict[str, np.ndarray]:
        return {}

    def header(self) -> dict[str, Any]:
        return {}


def test_the_truth_scores_full_marks():
    result = evaluate(Painted(), sequence())
    for split in ("novel_view", "unseen_pose", "training_view"):
        for region in ("body_crop", "whole"):
            assert result["psnr"][split][region] == 100.0
            assert result["lpips"][split][region] is None
        assert result["ssim"][split]["whole"] == pytest.approx(1.0)


def test_a_known_error_gives_its_psnr_and_json_holds_it():
    result = evaluate(Painted(0.1), sequence())
    assert result["psnr"]["novel_view"]["whole"] == pytest.approx(20.0, abs=0.1)
    assert len(result["per_view"]["novel_view"]) == 2
    assert result["conditions"]["resolution"]["novel_view"] == [48, 48]
    assert json.loads(json.dumps(result)) == result


def test_lpips_states_its_backbone():
    backbone = shared_data("models") / "squeezenet1_1_features.pth"
    result = evaluate(Painted(0.1), sequence(), backbone)
    assert result["lpips"]["novel_view"]["whole"] > 0.0
    assert result["conditions"]["lpips"] == {
        "backbone": "squeeze",
        "linear_layers": "0.1",
        "input_range": [-1, 1],
    }


def test_sides_never_seen_are_reported_apart():
    clip = sequence()
    front = [paint(body(), view(), pose(0.0, time_s=t)) for t in (0.0, 0.1)]
    shots = [paint(body(), view(azimuth), pose(0.0)) for azimuth in (0.2, np.pi)]
    half = replace(
        clip,
        train=Frames(front),
        motion=Motion.from_poses([frame.pose for frame in front]),
        test={NOVEL_VIEW: Frames(shots)},
    )
    result = evaluate(Painted(), half)
    assert [v["seen_side"] for v in result["per_view"][NOVEL_VIEW]] == [True, False]
    assert result["psnr"][NOVEL_VIEW]["whole"] == 100.0
    assert result["unseen_side"]["psnr"][NOVEL_VIEW]["whole"] == 100.0
    assert result["psnr"][UNSEEN_POSE]["whole"] is None


def test_a_clip_without_test_views_says_so():
    result = evaluate(Painted(), replace(sequence(), test={}))
    assert result["psnr"]["novel_view"] == {"body_crop": None, "whole": None}
    assert result["psnr"]["training_view"]["whole"] == 100.0


@pytest.mark.parametrize(
    ("turn", "azimuth", "side"),
    [(0.0, 0.0, 0.0), (0.0, np.pi / 2, np.pi / 2), (np.pi / 2, np.pi / 2, 0.0)],
)
def test_the_side_is_measured_from_the_front_to_the_left(turn, azimuth, side):
    got = side_of_body(view(azimuth), pose(turn), body().skeleton)
    assert got == pytest.approx(side, abs=1e-6)


def test_spread_and_moments_stand_beside_the_means():
    result = evaluate(Painted(0.1), sequence())
    views = [view["whole"]["psnr"] for view in result["per_view"]["novel_view"]]
    assert result["spread"]["psnr"]["novel_view"]["whole"] == pytest.approx(np.std(views), abs=1e-4)
    moments = result["per_frame"]["novel_view"]
    assert sum(moment["views"] for moment in moments) == len(views)
    weighted = sum(moment["views"] * moment["whole"]["psnr"] for moment in moments)
    assert weighted / len(views) == pytest.approx(np.mean(views), abs=1e-3)


def test_the_protocol_judges_one_moment_in_so_many_from_all_cameras():
    clip = sequence()
    times = [0.1 * moment for moment in (5, 20, 34, 35, 35, 65)]  # 10 frames/s, from the fifth
    shots = Frames([paint(body(), view(), pose(0.0, time_s=t)) for t in times])
    clip = replace(clip, test={NOVEL_VIEW: shots}, frames_per_second=10.0)
    result = evaluate(Painted(), clip, every=30)
    assert [v["index"] for v in result["per_view"][NOVEL_VIEW]] == [0, 3, 4, 5]
    assert [v["index"] for v in result["per_view"]["training_view"]] == [0]
    assert [m["views"] for m in result["per_frame"][NOVEL_VIEW]] == [1, 2, 1]
    assert result["conditions"]["every"] == 30


def test_every_picture_is_told_as_it_is_judged():
    told: list[EvaluatedView] = []
    evaluate(Painted(0.1), sequence(), on_view=told.append)
    assert {v.split for v in told} == {"novel_view", "unseen_pose", "training_view"}
    assert told[0].made.max() <= 1.0
    assert np.abs(told[0].made - told[0].truth).mean() == pytest.approx(0.1, abs=0.01)
