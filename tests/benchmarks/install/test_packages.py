"""What packages weigh: each direct dependency is told of, and nothing is counted twice."""

from __future__ import annotations

import tomllib
from importlib.metadata import distribution

import pytest
from packaging.requirements import Requirement

from benchmarks.install.packages import dependencies, files_of, megabytes, pulled_in, weights
from benchmarks.reporting.checkout import ROOT


def test_every_direct_dependency_is_told_of_and_nothing_else():
    read = tomllib.loads((ROOT / "pyproject.toml").read_text())
    told = read["tool"]["metanerf"]["dependencies"]
    assert list(told) == [Requirement(line).name for line in read["project"]["dependencies"]]
    for one in dependencies():
        assert one.use, one.name
        assert one.instead, one.name


def test_extras_are_pulled_in_only_where_they_are_asked_for():
    plain, standard = (pulled_in([Requirement(one)]) for one in ("uvicorn", "uvicorn[standard]"))
    assert {"uvicorn", "click", "h11"} <= plain
    assert standard - plain >= {"websockets"}


def test_two_packages_that_hold_the_same_files_count_once():
    names = ["opencv-contrib-python", "opencv-contrib-python-headless"]
    apart = [files_of([name]) for name in names]
    assert apart[0].keys() & apart[1].keys()
    assert megabytes(files_of(names)) < sum(map(megabytes, apart))


def test_what_goes_with_a_dependency_is_what_no_other_asks_for():
    named = {"numba", "numpy", "scipy"}
    direct = [one for one in dependencies() if one.name in named]
    rows = {row["name"]: row for row in weights(direct)}
    assert rows["numba"]["goes_with_it"] == ["llvmlite"]
    assert rows["numba"]["goes_with_it_mb"] > rows["numba"]["own_mb"]
    assert rows["numpy"]["goes_with_it_mb"] == 0.0  # the others ask for it
    assert rows["scipy"]["goes_with_it_mb"] == pytest.approx(rows["scipy"]["own_mb"])
    assert rows["scipy"]["version"] == distribution("scipy").version
