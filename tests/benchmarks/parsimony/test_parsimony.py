"""The ladder: what is changed, what parts are worth, what page and chart tell."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.pages.parsimony import parsimony
from benchmarks.parsimony.charts import draw_parsimony
from benchmarks.parsimony.measure import worth
from benchmarks.parsimony.rungs import LADDER, Rung
from benchmarks.parsimony.subjects import SUBJECTS, about
from renderer.splats.settings import SplatSettings
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


def test_subjects_differ_and_tell_their_clip():
    told = [about(subject) for subject in SUBJECTS]
    assert len({one["clip"] for one in told}) == len(SUBJECTS)
    assert sum(subject.real for subject in SUBJECTS) == 2


def test_the_page_shows_sizes_ladder_and_worth():
    page = parsimony(figures())
    assert "| real: somebody | 20,000 | 5,000 | 0.70 -> 0.20 |" in page
    assert "| 250 splats | 22.0 / 0.100; 0.70; 12 s | 22.0 / 0.100; 0.70; 12 s |" in page
    assert "**+1.00 ± 0.00**" in page
    assert page.count("| inset |  | ") == 1


def test_the_chart_is_drawn(tmp_path):
    path = tmp_path / "parsimony.png"
    draw_parsimony(figures(), path)
    assert path.stat().st_size > 10_000
    drawn = path.with_suffix(".svg").read_text()
    assert "MB that a page fetches" in drawn
    assert "<!-- .- -->" not in drawn, "a face that is not judged has no line"
