"""Commands that packages above `services` add to `metanerf`."""

from __future__ import annotations

from benchmarks import cli
from services.cli.extensions import command_groups

PROJECT = """
[project]
name = "other"

[project.entry-points."metanerf.commands"]
measure = "benchmarks.cli:app"
"""


def test_a_checkout_declares_its_groups_in_its_pyproject(tmp_path):
    (tmp_path / "pyproject.toml").write_text(PROJECT)
    assert list(command_groups(tmp_path)) == [("measure", cli.app)]
    assert ("bench", cli.app) in list(command_groups())


def test_a_checkout_without_groups_adds_none(tmp_path):
    (tmp_path / "pyproject.toml").write_text("[project]\nname = 'other'\n")
    assert list(command_groups(tmp_path)) == []
