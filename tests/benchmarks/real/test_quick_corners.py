"""Quick corners of `metanerf bench real` and `metanerf bench live-look`: the beginning of a real
clip, captured, trained for seconds and judged; then it plays to the model made of it, and shows it
sides that it has not seen, which it learns.

All three measure one capture and one training.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import pytest

from benchmarks.pages.live_look import live_look
from benchmarks.real import learning, measure
from benchmarks.real import live_look as look
from benchmarks.real.cases import Case
from benchmarks.real.filmed import FilmedClip
from renderer.performer_model import PerformerModel
from renderer.splats.layout import POSITION
from renderer.splats.training import sized_trainer
from scene.sequence import Sequence
from tests.benchmarks.real.quick import first_frames, networks

FIGURES = Path(__file__).parents[3] / "docs" / "figures" / "live-look.json"
CLIP = "patterned_shirt_eat"
FRAMES, TRAINED = 29, 22
"""A round of learning is held to clips of 20 frames or more."""
CASE = Case("quick", CLIP, trained_share=0.75)
PLAYED = replace(CASE, other_clips=(CLIP,))
STEPS = 120


@dataclass(frozen=True)
class Once:
    """What is measured, made when somebody asks for it first."""

    footage: Path
    clips: Callable[[], dict[str, FilmedClip]]
    model: Callable[[], PerformerModel]


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    footage, captured = tmp_path_factory.mktemp("footage"), tmp_path_factory.mktemp("captured")
    ruler = first_frames(CLIP, FRAMES, footage)
    captured_clips, trained_model = measure.captured_clips, measure.trained_model

    @cache
    def clips() -> dict[str, FilmedClip]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(measure.Ruler, "read", lambda name: {CLIP: ruler}[name])
            return captured_clips(CASE, footage, networks(), captured)

    @cache
    def model() -> PerformerModel:
        part, numbers = clips()[CLIP].training_part(CASE.trained_share)
        assert len(numbers) == TRAINED
        with pytest.MonkeyPatch.context() as patch:
            # nine tenths of such a short training would go into the choice of splats
            patch.setattr(sized_trainer, "WATCHED", 2)
            patch.setattr(sized_trainer, "REFIT_STEPS", (10, 10))
            return trained_model(part, STEPS)

    return Once(footage, clips, model)


@pytest.fixture
def footage(once: Once, fewer_steps: None, monkeypatch: pytest.MonkeyPatch) -> Path:
    for module in (measure, look, learning):
        monkeypatch.setattr(module, "captured_clips", lambda *_: once.clips())
        monkeypatch.setattr(module, "trained_model", lambda *_: once.model())
    return once.footage


def test_a_real_person_is_captured_trained_and_judged(tmp_path: Path, footage: Path):
    sheet = tmp_path / "sheet.jpg"
    figures = measure.measure(CASE, footage, networks(), STEPS, sheet)
    json.dumps(figures, allow_nan=False)
    assert figures["trained_frames"] == TRAINED
    assert figures["clips"][CLIP]["frames"] == FRAMES
    own, later = figures["as_given"]["own_views"], figures["as_given"]["later_frames"]
    assert (own["frames"], later["frames"]) == (6, 2)
    # far below what a training of a minute reaches, far above what a wrong camera would
    assert own["body"]["psnr"] > 15.0
    assert own["body"]["iou"] > 0.85
    # eyes that were drawn at random would be off by a third of their width
    assert own["face"]["irises_percent"] < 15.0
    assert figures["aligned"]["later_frames"]["body"]["psnr"] >= later["body"]["psnr"] - 0.2
    drawn = cv2.imread(str(sheet))
    assert drawn is not None
    assert drawn.shape[0] > 600


def test_live_look_comes_nearer_to_the_frames_than_the_model(tmp_path: Path, footage: Path):
    sheet = tmp_path / "sheet.jpg"
    figures = look.measure(PLAYED, footage, networks(), STEPS, sheet)
    json.dumps(figures, allow_nan=False)
    model, live = figures["webcam"]["model"], figures["webcam"]["live"]
    assert model["frames"] == live["frames"] == 8
    for part in ("body", "face", "hands"):
        assert live[part]["psnr"] > model[part]["psnr"] + 0.5, part
    for part in ("body", "hands"):
        assert live[part]["lpips"] < 0.95 * model[part]["lpips"], part
    # a face is sharp without it, and by 3 or 6 % sharper with it, as processors round
    assert live["face"]["lpips"] < model["face"]["lpips"]
    assert live["face"]["points_percent"] < 0.95 * model["face"]["points_percent"]
    assert "other_cameras" not in figures
    drawn = cv2.imread(str(sheet))
    assert drawn is not None
    assert drawn.shape[0] > 5 * 300


def test_what_a_film_shows_anew_is_kept_learnt_and_judged(
    once: Once, footage: Path, monkeypatch: pytest.MonkeyPatch
):
    def of_one_side(part: Sequence, iterations: int) -> PerformerModel:
        """The model, whose left side counts as never filmed."""
        splats = once.model().splats
        assert splats is not None
        return replace(splats, seen=splats.seen & (splats.parameters[:, POSITION] < 0.0))

    monkeypatch.setattr(learning, "trained_model", of_one_side)
    figures = learning.measure(PLAYED, footage, networks(), STEPS)
    json.dumps(figures, allow_nan=False)
    # half of 29 frames, of which fifteen a second are sent
    assert 5 <= figures["seen"] <= 14
    assert 1 <= figures["kept"] <= figures["seen"]
    assert any(side.startswith("head") for side in figures["sides"])
    before, after = figures["before"], figures["after"]
    assert before["frames"] == after["frames"] == 4
    assert before["body"]["iou"] > 0.85
    if figures["forgot"] is None:
        assert after["body"] != before["body"]
        assert set(figures["held_to"]["lost_db"]) >= {"body", "face"}
    else:
        assert after["body"] == before["body"]
    told = {**json.loads(FIGURES.read_text()), "learning": {"quick": figures}}
    row = next(line for line in live_look(told).splitlines() if line.startswith("| quick"))
    assert f"{figures['kept']} of {figures['seen']}" in row
