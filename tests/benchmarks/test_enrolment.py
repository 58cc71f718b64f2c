"""When what came of a clip, from what its jobs say."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.enrolment import Timeline


def job(state: str, model_id: str | None = None) -> dict[str, Any]:
    return {"kind": "train", "state": state, "model_id": model_id, "message": "nobody is seen"}


def test_a_first_likeness_comes_before_the_capture_is_over():
    timeline = Timeline()
    timeline.note(1.0, job("running"), job("queued"))
    timeline.note(20.04, job("running"), job("queued", "likeness"))
    timeline.note(21.0, job("running"), job("queued", "likeness"))
    timeline.note(45.0, job("succeeded"), job("queued", "likeness"))
    timeline.note(52.0, job("succeeded"), job("running", "round 1"))
    timeline.note(75.0, job("succeeded"), job("succeeded", "round 2"))
    assert timeline.figures() == {
        "first_likeness_s": 20.0,
        "captured_s": 45.0,
        "rounds_s": [52.0, 75.0],
        "model_s": 75.0,
    }


def test_a_training_without_a_likeness_has_none():
    timeline = Timeline()
    timeline.note(45.0, job("succeeded"), job("running"))
    timeline.note(52.0, job("succeeded"), job("succeeded", "round 1"))
    assert timeline.figures()["first_likeness_s"] is None
    assert timeline.figures()["rounds_s"] == [52.0]


def test_what_fails_is_told():
    with pytest.raises(RuntimeError, match="got nobody is seen"):
        Timeline().note(3.0, job("failed"), job("failed"))
    with pytest.raises(RuntimeError, match="must become a model"):
        Timeline().figures()
