"""What `bench live-look` tells of learning: a film shows sides that a model has not seen."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.pages.live_look import live_look
from benchmarks.real import learning as benchmark
from benchmarks.real.cases import Case
from benchmarks.real.learning import measure
from renderer.performer_model import PerformerModel
from renderer.splats.layout import POSITION
from scene.sequence import Sequence
from tests.benchmarks.real.test_measure import networks
from tests.shared_data import shared_data

FIGURES = Path(__file__).parents[3] / "docs" / "figures" / "live-look.json"
CLIP = "patterned_shirt_eat"


@pytest.mark.usefixtures("fewer_steps")
def test_what_a_film_shows_anew_is_kept_learnt_and_judged(monkeypatch: pytest.MonkeyPatch):
    train = benchmark.trained_model

    def of_one_side(part: Sequence, iterations: int) -> PerformerModel:
        """A model whose left side counts as never filmed."""
        splats = train(part, iterations).splats
        assert splats is not None
        return replace(splats, seen=splats.seen & (splats.parameters[:, POSITION] < 0.0))

    monkeypatch.setattr(benchmark, "trained_model", of_one_side)
    footage = shared_data("real-webcam-people").parent
    case = Case("quick", CLIP, other_clips=(CLIP,))
    figures = measure(case, footage, networks(), 150)
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
