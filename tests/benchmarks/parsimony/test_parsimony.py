"""The ladder: what is changed, what parts are worth, what page and chart tell."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.pages.parsimony import parsimony
from benchmarks.parsimony.charts import draw_parsimony
from benchmarks.parsimony.measure import worth
from benchmarks.parsimony.rungs import LADDER, Rung
from benchmarks.parsimony.subjects import SUBJECTS, about
from renderer.splats.settings import SplatSettings
from scene.expression import BLEND_SHAPE_COUNT, CURLS, EXPRESSION_COUNT
from tests.renderer.studio import make_sequence


def row(subject: str, group: str, name: str, seed: int, psnr: float) -> dict[str, Any]:
    real = subject == "real"
    return {
        "subject": subject,
        "group": group,
        "name": name,
        "seed": seed,
        "splats": 5000 if name == "auto" else 20_000,
        "megabytes": 1.0,
        "viewer_megabytes": 0.2 if name == "auto" else 0.7,
        "parameters": 24 * 20_000,
        "training_s": 12.0,
        "p50_ms": 3.0,
        "p95_ms": 4.0,
        "body_psnr": psnr,
        "body_lpips": 0.1,
        "face_psnr": psnr if real else None,
        "face_lpips": 0.05 if real else None,
    }


def rows() -> list[dict[str, Any]]:
    made = []
    for subject in ("studio", "real"):
        made += [row(subject, "size", "full", seed, 30.0 + 0.1 * seed) for seed in (0, 1)]
        made += [row(subject, "size", "auto", seed, 30.0) for seed in (0, 1)]
        made += [row(subject, "number", "250", 0, 22.0), row(subject, "number", "8000", 0, 29.0)]
        made += [row(subject, "pictures", "128", 0, 27.0)]
        made += [row(subject, "expressions", "half", 0, 28.0)] if subject == "real" else []
        made += [row(subject, "without", "flat splats", seed, 29.0 + 0.1 * seed) for seed in (0, 1)]
    made.append(row("real", "without", "inset", 0, 30.0))
    return made


def figures() -> dict[str, Any]:
    return {
        "lpips": "alexnet",
        "subjects": [{"name": name, "words": "somebody"} for name in ("studio", "real")],
        "rows": rows(),
        "worth": worth(rows()),
        "date": "2026-11-25",
        "commit": "abc",
        "uncommitted_changes": False,
        "machine": {"processor": "a processor"},
    }


def test_a_part_is_worth_what_is_lost_without_it_seed_by_seed():
    found = {(one["subject"], one["name"]): one for one in worth(rows())}
    flat = found["studio", "flat splats"]
    assert flat["seeds"] == 2
    assert flat["body_psnr"] == pytest.approx(1.0)
    assert flat["body_psnr_spread"] == pytest.approx(0.0, abs=1e-6)
    assert "face_psnr" not in flat
    assert found["real", "inset"]["seeds"] == 1


def test_every_rung_changes_one_thing_and_has_a_name_of_its_own():
    names = [(rung.group, rung.name) for rung in LADDER]
    assert len(set(names)) == len(names)
    clip = make_sequence()
    same = Rung("size", "full")
    for rung in LADDER[1:]:
        changed = rung.settings(SplatSettings()) != SplatSettings()
        changed |= rung.clip(clip) is not clip
        changed |= (rung.find_light, rung.size) != (same.find_light, same.size)
        assert changed, rung.name


def test_without_expressions_none_are_known():
    without = next(rung for rung in LADDER if rung.name == "expressions")
    clip = without.clip(make_sequence())
    assert clip.body.expression_directions is None
    assert not clip.motion.expressions.any()


def test_half_of_the_expressions_are_those_that_the_clip_shows_most():
    clip = make_sequence()
    shown = np.zeros_like(clip.motion.expressions)
    shown[:, 1::2], shown[:, ::2] = 0.5, 0.1
    assert clip.body.rest_vertices is not None
    directions = np.ones((BLEND_SHAPE_COUNT, *clip.body.rest_vertices.shape))
    body = replace(clip.body, expression_directions=directions)
    clip = replace(clip, body=body, motion=replace(clip.motion, expressions=shown))
    half = next(rung for rung in LADDER if rung.group == "expressions").clip(clip)
    assert (half.motion.expressions[:, 1::2] == 0.5).all()
    assert not half.motion.expressions[:, ::2].any()
    kept = half.body.expression_directions
    assert kept is not None
    assert (kept[:EXPRESSION_COUNT][1::2] == 1.0).all()
    assert not kept[:EXPRESSION_COUNT][::2].any()
    curls = np.arange(CURLS.start, CURLS.stop)
    in_between = kept[EXPRESSION_COUNT:].any(axis=(1, 2))
    assert (in_between == (curls % 2 == 1)).all(), "a finger's curl keeps its in-between, or loses"


def test_subjects_differ_and_tell_their_clip():
    told = [about(subject) for subject in SUBJECTS]
    assert len({one["clip"] for one in told}) == len(SUBJECTS)
    assert sum(subject.real for subject in SUBJECTS) == 2


def test_the_page_shows_sizes_ladder_and_worth():
    page = parsimony(figures())
    assert "| real: somebody | 20,000 | 5,000 | 0.70 -> 0.20 |" in page
    assert "| 250 splats | 22.0 / 0.100 | 480.0 k | 0.70 | 3.0 | 12 |" in page
    shown = "| {} | {} / 0.100 | {} | 480.0 k | 0.70 | 3.0 | 12 |"
    assert shown.format("250 splats", "22.0", "22.0 / 0.050") in page
    all_of_them = shown.format("as many as the clip shows pixels", "30.1", "30.1 / 0.050")
    assert all_of_them in page, "the mean over seeds"
    half = shown.format("the same, half of the expressions", "28.0", "28.0 / 0.050")
    assert page.index(all_of_them) < page.index(half)
    assert "**+1.00 ± 0.00**" in page
    assert page.count("| inset |  | ") == 1


def test_the_page_shows_a_field_where_one_was_measured():
    assert "neural field" not in parsimony(figures())
    of_two = [
        row("studio", "field", "as it is", 0, 30.0),
        row("studio", "field", "as it is", 1, 31.0),
        {**row("real", "field", "as it is", 0, 28.0), "training_s": 48.0, "megabytes": 4.0},
        row("studio", "field", "1 channel", 0, 29.0),
        {**row("real", "field", "refiner on", 0, 27.0), "training_s": 211.0},
    ]
    page = parsimony({**figures(), "rows": [*rows(), *of_two]})
    assert "| body; face, dB / LPIPS | studio | real | parameters | MB | " in page
    of_both = "| as it is | 30.5 / 0.100 | 28.0 / 0.100; 28.0 / 0.050 | 480.0 k | 1.00 | 3.0 | 12 |"
    assert of_both in page, "costs are of the first"
    assert "| refiner on |  | 27.0 / 0.100; 27.0 / 0.050 | 480.0 k | 1.00 | 3.0 | 211 |" in page
    assert "| 1 channel | 29.0 / 0.100 |  | 480.0 k | 1.00 | 3.0 | 12 |" in page


def test_rows_of_before_parameters_were_told_leave_them_out():
    made = rows()
    for one in made:
        if one["name"] == "250" or one["subject"] == "real":
            del one["parameters"]
    page = parsimony({**figures(), "rows": made})
    assert "| 250 splats | 22.0 / 0.100 |  | 0.70 | 3.0 | 12 |" in page
    assert "| 250 splats | 22.0 / 0.100 | 22.0 / 0.050 | 0.70 | 3.0 | 12 |" in page


def test_the_chart_is_drawn(tmp_path):
    path = tmp_path / "parsimony.png"
    draw_parsimony(figures(), path)
    assert path.stat().st_size > 10_000
    drawn = path.with_suffix(".svg").read_text()
    assert "MB that a page fetches" in drawn
    assert "<!-- .- -->" not in drawn, "a face that is not judged has no line"
