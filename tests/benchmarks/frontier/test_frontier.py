"""The frontier: who is on it, which time belongs to which accuracy, what page and charts tell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.frontier.charts import draw_charts
from benchmarks.frontier.measure import points
from benchmarks.frontier.pareto import pareto_front
from benchmarks.frontier.speed import STEPS, timed
from benchmarks.frontier.training import SCALED, Scale
from benchmarks.pages.frontier import page
from benchmarks.reporting.timing import Clock
from renderer.field.settings import FieldSettings
from renderer.presets import EXACT, PRESETS, find_preset
from scene.camera import Camera
from scene.motion import Pose
from tests.renderer.field.performer import sequence

ALL_EXACT = "+".join(("paper", *EXACT))


def test_the_front_is_what_nothing_beats_in_both():
    points = [(10.0, 20.0), (5.0, 30.0), (1.0, 10.0), (5.0, 25.0), (50.0, 31.0), (60.0, 31.0)]
    assert pareto_front(points) == [2, 1, 4]
    assert pareto_front([]) == []


def accuracy(preset: str, budget_s: float, psnr: float, **more: Any) -> dict[str, Any]:
    row: dict[str, Any] = {
        "preset": preset,
        "budget_s": budget_s,
        "steps": 900,
        "file_megabytes": 1.0,
        "train_seconds": budget_s,
        "published_iterations": 150_000,
        "conditions": {"lpips": {"backbone": "squeeze"}},
    }
    for split in ("novel_view", "unseen_pose"):
        row |= {f"psnr_{split}_body_crop": psnr, f"ssim_{split}_body_crop": 0.9}
        row[f"lpips_{split}_body_crop"] = 0.0123
    return row | more


def speed(preset: str, ms: float, px: int, db: float = 60.0) -> dict[str, Any]:
    at = {"p50_ms": ms, "p95_ms": 1.2 * ms, "frames": 5}
    return {
        "preset": preset,
        "512": {**at, "measured_px": min(px, 512)},
        "1024": {**at, "measured_px": px},
        "parameters": 64e6,
        "megabytes": 6.6,
        "db_to_slow": db,
    }


def figures() -> dict[str, Any]:
    scaled = {"patches": 2, "samples": 32}
    return {
        "clock": "wall",
        "threads": 2,
        "accuracy": [
            accuracy("splats", 2.0, 31.0),
            accuracy("splats", 20.0, 33.0),
            accuracy("paper", 3600.0, 22.0, scaled=scaled),
        ],
        "speed": [speed("splats", 6.0, 1024)],
        "steps": [
            speed("paper", 9e4, 128),
            speed(ALL_EXACT, 1e3, 512),
            speed("paper+posed-grid", 2e4, 128, db=38.0),
        ],
    }


def test_a_point_joins_the_longest_budget_with_the_time_of_its_preset():
    shown = {p["preset"]: p for p in points(figures())}
    assert set(shown) == {"splats", "paper", ALL_EXACT}  # other pictures have other accuracy
    assert shown["splats"]["psnr_novel_view_body_crop"] == 33.0
    assert shown["splats"]["scaled"] is None
    assert shown[ALL_EXACT]["psnr_novel_view_body_crop"] == 22.0
    assert shown[ALL_EXACT]["512"]["p50_ms"] == 1e3


def test_the_page_marks_what_is_scaled_estimated_and_on_the_front():
    text = page(figures(), points(figures()))
    assert "](figures/frontier-steps.png)" in text
    assert (
        "| **splats** | 6.0 (7.2) | 6.0 (7.2) | 33.0 / 33.0 | 0.900 / 0.900 | 12.3 / 12.3 |" in text
    )
    assert "| paper | 90,000 (108,000) * |" in text
    assert "3600 s (scaled)" in text
    assert (
        "2 patches of 20 x 20 px a step (published: 6), 32 samples a ray (128), 900 steps" in text
    )
    assert "x1000, squeeze backbone, inputs in [-1, 1]" in text
    assert "| paper + all exact | 1,000 (1,200) | 1,000 (1,200) * | 90.0 / 90.0 | 60 |" in text


def test_charts_are_drawn_with_what_there_is(tmp_path):
    draw_charts(figures(), points(figures()), tmp_path / "frontier.json")
    nothing: dict[str, Any] = {**figures(), "accuracy": [], "speed": [], "steps": []}
    (tmp_path / "empty").mkdir()
    draw_charts(nothing, [], tmp_path / "empty" / "frontier.json")
    for folder in (tmp_path, tmp_path / "empty"):
        drawn = sorted(p.name for p in folder.glob("frontier*"))
        assert drawn == [
            f"frontier{part}.{kind}"
            for part in ("-steps", "-training", "")
            for kind in ("png", "svg")
        ]
    words = (tmp_path / "frontier.svg").read_text()
    assert words.count("<!-- paper + all exact") == 2


def test_a_scaled_preset_keeps_the_networks_and_says_what_is_cut():
    for name, scale in SCALED.items():
        whole, cut = find_preset(name).settings, scale.of(find_preset(name)).settings
        assert isinstance(whole, FieldSettings)
        assert isinstance(cut, FieldSettings)
        for network in ("colour", "residual", "refiner", "latent", "volume", "octaves"):
            assert getattr(cut.sizes, network) == getattr(whole.sizes, network)
        assert (cut.field_rate, cut.motion_rate) == (whole.field_rate, whole.motion_rate)
        assert cut.rays_a_frame == scale.patches * 400 < whole.rays_a_frame
        assert cut.sizes.samples_a_ray < whole.sizes.samples_a_ray
    assert Scale(6, 128).of(PRESETS["paper"]).settings == PRESETS["paper+cull"].settings


def test_every_step_is_a_preset():
    assert {name.split("+")[0] for name in STEPS} == {"humannerf", "paper"}
    assert all(find_preset(name).name == name for name in STEPS)


@pytest.mark.parametrize(("second_a_view", "estimated"), [(0.001, False), (1.0, True)])
def test_a_slow_frame_is_estimated_from_a_smaller_one(second_a_view, estimated):
    now_s = 0.0

    def draw(camera: Camera, _: Pose) -> np.ndarray:
        nonlocal now_s
        now_s += second_a_view * (camera.width / 64) ** 2
        return np.zeros(0)

    row = timed(sequence(), draw, Clock("fake", lambda: now_s, 1))["512"]
    assert row["p50_ms"] == pytest.approx(64_000.0 * second_a_view)  # 64 times the pixels of 64
    assert (row["measured_px"] < 512) == estimated
    assert row["frames"] >= 3
    assert now_s < 120.0  # for all sizes together
