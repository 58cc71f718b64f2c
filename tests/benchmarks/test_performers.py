"""The README's table: means over performers, unseen views beside unseen poses."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.pages.performers import expressions_found, lifelike, table
from benchmarks.performers import means


def cell(look: str, performer: str, psnr: float, lpips: float | None) -> dict[str, Any]:
    row: dict[str, Any] = {"look": look, "performer": performer, "preset": "fast", "budget_s": 90.0}
    for split, less in (("novel_view", 0.0), ("unseen_pose", 1.0)):
        row |= {
            f"psnr_{split}_body_crop": psnr - less,
            f"ssim_{split}_body_crop": 0.97,
            f"lpips_{split}_body_crop": lpips,
        }
    return row


def test_means_are_over_the_performers_of_one_look():
    rows = [
        cell("plain", "amber", 30.0, 0.01),
        cell("plain", "basil", 34.0, 0.02),
        cell("lit", "amber", 28.0, None),
    ]
    plain, lit = means(rows)
    assert (plain["performers"], lit["performers"]) == (2, 1)
    assert plain["psnr_novel_view"] == pytest.approx(32.0)
    assert plain["psnr_novel_view_spread"] == pytest.approx(2.0)
    assert plain["lpips_unseen_pose"] == pytest.approx(0.015)
    assert lit["lpips_novel_view"] is None
    assert table([plain, lit]).splitlines()[2:] == [
        "| plain | `fast` | 90 s | 32.0 / 31.0 (± 2.0) | 0.970 / 0.970 | 15.0 / 15.0 |",
        "| lit | `fast` | 90 s | 28.0 / 27.0 (± 0.0) | 0.970 / 0.970 | - / - |",
    ]


def test_lifelike_performers_are_listed_each_by_itself():
    row = cell("plain", "moss", 33.26, 0.0124)
    row |= {"tone": "dark", "age": "middle-aged", "hair": "short04", "commit": "abcdef0"}
    origin = {
        "commit": "abcdef0",
        "date": "2026-05-01T12:00:00+00:00",
        "uncommitted_changes": False,
        "machine": {"processor": "a processor"},
    }
    figures = {
        "frames": 60,
        "size": 256,
        "poses": "exact",
        "budget_s": 60.0,
        "lpips": "alexnet_features.pth",
        "region": "body crop",
        "must": {"psnr": 32.0, "lpips": 0.05},
        "rows": [{**row, **origin}],
    }
    text = lifelike(figures)
    assert "| moss | dark, middle-aged | short04 | 33.3 / 0.012 | 32.3 / 0.012 |" in text
    assert "60 s of one thread" in text
    assert "`alexnet_features`" in text


def test_what_is_found_of_an_expression_is_told_beside_what_was_performed():
    rows = [{"skin": {"jaw_open": {"error": error, "spread": 0.4}}} for error in (0.05, 0.15)]
    figures = {
        "pictures": 30,
        "size": 256,
        "rows": rows,
        "means": {
            "gaze_deg": 4.44,
            "gaze_spread_deg": 10.0,
            "finger_joints_deg": 8.26,
            "hands_found": 0.96,
        },
        "commit": "abcdef0",
        "date": "2026-05-01T12:00:00+00:00",
        "uncommitted_changes": False,
        "machine": {"processor": "a processor"},
    }
    text = expressions_found(figures)
    assert "| eyes aside | 4.4° | 10.0° |" in text
    assert "| jaw open | 0.10 | 0.40 |" in text
    assert "of which 96 % were found" in text
