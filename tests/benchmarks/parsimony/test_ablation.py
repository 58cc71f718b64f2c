"""Parts left out alone: what stands in for them, whom they are judged on, what the page tells."""

from __future__ import annotations

import json
import pkgutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import capture.pipeline
from benchmarks.lifelike_look import performances
from benchmarks.pages.ablation import ablation
from benchmarks.parsimony import costs
from benchmarks.parsimony.ablation import run
from benchmarks.parsimony.measure import measured, worth
from benchmarks.parsimony.parts import PARTS, WHOLE
from benchmarks.parsimony.people import (
    PEOPLE,
    PLACES_DEG,
    FilmedFromFront,
    RealPerson,
    drifting,
)
from benchmarks.parsimony.rungs import AS_IT_IS, patched
from benchmarks.parsimony.subjects import OutsideData
from benchmarks.real.measure import Networks
from benchmarks.reporting.checkout import Checkout
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import clock_named
from renderer.evaluation.lpips import PACKAGED_BACKBONE
from renderer.splats.settings import SplatSettings
from scene.expression import GAZE
from scene.skeleton import JOINT_NAMES
from tests.renderer.studio import make_sequence
from tests.shared_data import shared_data


@pytest.fixture
def outside() -> OutsideData:
    assets = shared_data("human-assets")
    unused = Path("unused")
    networks = Networks(unused, unused, unused, PACKAGED_BACKBONE)
    return OutsideData(unused, assets, unused, networks)


def test_every_part_changes_something_and_has_a_name_of_its_own():
    rungs = [part.rung for part in PARTS]
    assert len({rung.name for rung in rungs}) == len(rungs)
    clip = make_sequence()
    for rung in rungs:
        changed = rung.settings(SplatSettings()) != SplatSettings()
        changed |= rung.clip(clip) is not clip
        assert changed or rung.patches, rung.name


@pytest.mark.parametrize(
    "part", [part for part in PARTS if part.rung.patches], ids=lambda part: part.rung.name
)
def test_what_is_patched_is_there_and_comes_back(part):
    ((name, instead),) = part.rung.patches
    before = pkgutil.resolve_name(name)
    assert before is not instead
    with patched(part.rung.patches):
        assert pkgutil.resolve_name(name) is instead
    assert pkgutil.resolve_name(name) is before


def test_a_patch_of_what_is_gone_is_an_error():
    with pytest.raises(AttributeError), patched((("capture.pipeline.gone", 1),)):
        pass


def test_parts_are_judged_on_people_and_those_of_the_capture_on_captured_ones():
    for part in PARTS:
        assert part.people
        for name in part.people:
            film = PEOPLE[name].film
            assert isinstance(film, RealPerson) or not part.rung.captured_anew


def test_without_gaze_eyes_look_ahead_and_the_rest_of_the_face_moves():
    clip = make_sequence()
    motion = replace(clip.motion, expressions=np.full_like(clip.motion.expressions, 0.5))
    (gaze,) = (part.rung for part in PARTS if part.rung.name == "gaze")
    shown = gaze.clip(replace(clip, motion=motion)).motion.expressions
    assert not shown[:, GAZE].any()
    assert (np.delete(shown, GAZE, axis=1) == 0.5).all()


def test_a_camera_drifts_by_so_many_stops(tmp_path):
    for number in range(30):
        cv2.imwrite(str(tmp_path / f"{number:02d}.png"), np.full((64, 64, 3), 100, np.uint8))
    with patched(drifting(1.0)):
        images = capture.pipeline.read_clip(tmp_path, 30).images
    levels = np.array([image.mean() for image in images])
    assert np.log2(levels.max() / levels.min()) * 2.2 == pytest.approx(1.0, abs=0.06)
    assert drifting(0.0) == ()


def test_sides_are_judged_where_the_camera_was_not(tmp_path, outside, monkeypatch):
    monkeypatch.setattr(performances, "SECONDS", 0.6)
    monkeypatch.setattr(costs, "VIEW_PX", 128)
    filmed = FilmedFromFront("hazel", size=64, frames=12)(tmp_path / "hazel", outside)
    yaw = filmed.clip.motion.joint_angles[:, JOINT_NAMES.index("pelvis"), 1]
    assert np.degrees(np.ptp(yaw)) == pytest.approx(30.0, abs=1.0)
    (strands,) = (part.rung for part in PARTS if part.rung.name == "strands")
    figures = {f"{place}_{name}" for place in PLACES_DEG for name in ("psnr", "lpips")}
    whole, without = (
        measured(rung, 0, 40, filmed, clock_named("processor"), tmp_path / "begun")
        for rung in (WHOLE, strands)
    )
    assert whole["splats"] > without["splats"], "each wide splat of hair becomes several"
    assert all(whole[name] > 0.0 for name in figures)
    assert len(list((tmp_path / "begun").iterdir())) == 1, "they go on from one training"


def row(name: str, seed: int, value: float, subject: str, *measures: str) -> dict[str, Any]:
    group = AS_IT_IS.group if name == AS_IT_IS.name else "without"
    of = {"subject": subject, "group": group, "name": name, "seed": seed}
    return of | {
        f"{one}_{kind}": value + (0.0 if kind == "psnr" else 1.0)
        for one in measures
        for kind in ("psnr", "lpips", "points_percent", "irises_percent")
    }


def figures() -> dict[str, Any]:
    rows = []
    for seed in (0, 1):
        rows += [
            row("full", seed, 30.0, "hazel", "front", "beside"),
            row("strands", seed, 29.0, "hazel", "front", "beside"),
            row("full", seed, 30.0, "grey-shirt", "body", "face"),
            row("smooth hands", seed, 30.0 + 0.1 * seed, "grey-shirt", "body", "face"),
        ]
    return {
        "lpips": "alexnet",
        "command": "metanerf bench ablation",
        "people": [{"name": name, "words": "somebody"} for name in PEOPLE],
        "rows": rows,
        "worth": worth(rows),
        "date": "2026-11-27",
        "commit": "abc",
        "uncommitted_changes": False,
        "machine": {"processor": "a processor"},
    }


def test_the_page_tells_of_sides_apart_and_of_a_face_by_its_points():
    page = ablation(figures())
    assert "| strands | hazel | **+1.00 ± 0.00** / **-1000.0 ± 0.0** | " in page
    hands = next(line for line in page.splitlines() if line.startswith("| smooth hands"))
    assert hands.count("-0.05 ± 0.05") == 2
    assert hands.endswith("| +0.05 ± 0.05 / +0.05 ± 0.05 |")
    assert "\n\nhazel: somebody; grey-shirt: somebody.\n\n" in page


def test_a_table_of_nobody_is_left_out():
    of_all = figures()
    lifelike = [one for one in of_all["worth"] if one["subject"] == "hazel"]
    page = ablation({**of_all, "worth": lifelike})
    assert "| left out | person | front | beside | behind |" in page
    assert "| left out | person | body |" not in page


def test_only_what_is_asked_for_is_measured(tmp_path, outside):
    writer = FigureWriter.start("ablation", checkout=Checkout(tmp_path), words=["bench"])
    run(writer, outside, "processor", "nothing of this name")
    written = json.loads(writer.file.built.read_text())
    assert written["rows"] == written["worth"] == []
    assert [one["name"] for one in written["people"]] == list(PEOPLE)
