"""Quick corners of `metanerf bench live-look`: a clip that plays to the model made of it, and sides
that a model has not seen, which it is shown and learns."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
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
from scene.sequence import Sequence
from tests.benchmarks.real.test_measure import networks
from tests.shared_data import shared_data

FIGURES = Path(__file__).parents[3] / "docs" / "figures" / "live-look.json"
CLIP = "patterned_shirt_eat"
CASE = Case("quick", CLIP, other_clips=(CLIP,))
STEPS = 150


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], dict[str, FilmedClip]]:
    """The clip is captured for both."""
    folder = tmp_path_factory.mktemp("clips")
    footage = shared_data("real-webcam-people").parent
    return cache(lambda: measure.captured_clips(CASE, footage, networks(), folder))


@pytest.fixture
def footage(
    once: Callable[[], dict[str, FilmedClip]], fewer_steps: None, monkeypatch: pytest.MonkeyPatch
) -> Path:
    for module in (look, learning):
        monkeypatch.setattr(module, "captured_clips", lambda *_: once())
    return shared_data("real-webcam-people").parent


def test_live_look_comes_nearer_to_the_frames_than_the_model(tmp_path: Path, footage: Path):
    sheet = tmp_path / "sheet.jpg"
    figures = look.measure(CASE, footage, networks(), STEPS, sheet)
    json.dumps(figures, allow_nan=False)
    model, live = figures["webcam"]["model"], figures["webcam"]["live"]
    assert model["frames"] == live["frames"] == 12
    for part in ("body", "face", "hands"):
        assert live[part]["lpips"] < 0.95 * model[part]["lpips"], part
        assert live[part]["psnr"] > model[part]["psnr"] + 0.5, part
    assert "other_cameras" not in figures
    drawn = cv2.imread(str(sheet))
    assert drawn is not None
    assert drawn.shape[0] > 5 * 300


def test_what_a_film_shows_anew_is_kept_learnt_and_judged(
    footage: Path, monkeypatch: pytest.MonkeyPatch
):
    train = learning.trained_model

    def of_one_side(part: Sequence, iterations: int) -> PerformerModel:
        """A model whose left side counts as never filmed."""
        splats = train(part, iterations).splats
        assert splats is not None
        return replace(splats, seen=splats.seen & (splats.parameters[:, POSITION] < 0.0))

    monkeypatch.setattr(learning, "trained_model", of_one_side)
    figures = learning.measure(CASE, footage, networks(), STEPS)
    json.dumps(figures, allow_nan=False)
    # half of 47 frames, of which fifteen a second are sent
    assert 8 <= figures["seen"] <= 24
    assert 1 <= figures["kept"] <= figures["seen"]
    assert any(side.startswith("head") for side in figures["sides"])
    before, after = figures["before"], figures["after"]
    assert before["frames"] == after["frames"] == 6
    assert before["body"]["iou"] > 0.85
    if figures["forgot"] is None:
        assert after["body"] != before["body"]
        assert set(figures["held_to"]["lost_db"]) >= {"body", "face"}
    else:
        assert after["body"] == before["body"]
    told = {**json.loads(FIGURES.read_text()), "learning": {"quick": figures}}
    row = next(line for line in live_look(told).splitlines() if line.startswith("| quick"))
    assert f"{figures['kept']} of {figures['seen']}" in row
