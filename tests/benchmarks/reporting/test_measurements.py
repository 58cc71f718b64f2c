"""Measurements outlive a cut, and only what is still true of the same thing."""

from __future__ import annotations

import json

import pytest

from benchmarks.reporting.measurements import MeasurementCache


def test_a_run_that_was_cut_goes_on(tmp_path):
    done: list[str] = []

    def measuring(name: str):
        def measure():
            if name == "b" and "b" not in done:
                done.append("b")
                raise KeyboardInterrupt
            done.append(name)
            return {"ms": 1.5}

        return measure

    def run():
        return [
            MeasurementCache(tmp_path).measured(f"speed/{n}", {"of": n}, measuring(n))
            for n in "abc"
        ]

    with pytest.raises(KeyboardInterrupt):
        run()
    assert [path.name for path in tmp_path.iterdir()] == ["speed-a.json"]
    figures = run()
    assert done == ["a", "b", "b", "c"]
    assert [row["ms"] for row in figures if row is not None] == [1.5, 1.5, 1.5]
    assert {"machine", "commit"} <= set(figures[0] or {})
    assert not list(tmp_path.glob("*.part"))


def test_figures_of_something_else_are_measured_anew(tmp_path):
    cache = MeasurementCache(tmp_path)
    for clip, wanted in (("one", 1), ("one", 1), ("other", 3)):
        counter = iter([wanted])
        row = cache.measured("x", {"data": clip, "sizes": (1, 2)}, lambda c=counter: {"n": next(c)})
        assert row is not None
        assert row["n"] == wanted
    stored = json.loads((tmp_path / "x.json").read_text())
    assert stored["of"] == {"data": "other", "sizes": [1, 2]}


def test_what_is_left_out_is_shown_only_if_it_is_there(tmp_path):
    whole, part = MeasurementCache(tmp_path), MeasurementCache(tmp_path, only="splats")
    assert part.measured("speed/fast", {}, dict) is None
    assert part.measured("speed/splats", {}, lambda: {"ms": 2}) is not None
    whole.measured("speed/fast", {}, lambda: {"ms": 7})
    row = part.measured("speed/fast", {}, dict)
    assert row is not None
    assert row["ms"] == 7
