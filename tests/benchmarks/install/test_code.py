"""Counts of lines, settings, operations and options."""

from __future__ import annotations

from pathlib import Path

from benchmarks.install.code import commands, lines, lines_by_package, settings_count
from benchmarks.install.start_up import help_ms, import_ms
from tests.services.test_settings import DEFAULTS


def test_lines_that_say_something_are_counted(tmp_path: Path):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "one.py").write_text("a = 1\n\n    \nb = 2\n")
    (tmp_path / "two.ts").write_text("const a = 1;\n")
    (tmp_path / "words.md").write_text("many\nlines\n")
    assert lines(tmp_path) == 3


def test_every_package_has_lines():
    assert all(lines_by_package().values())


def test_settings_and_commands_are_those_that_people_meet():
    assert settings_count() == len(DEFAULTS)
    found = commands()
    assert found["commands"] >= 10
    assert found["options"] > found["commands"]


def test_a_module_that_imports_more_takes_longer():
    assert import_ms("asyncio", 2)["processor_ms"] > import_ms("keyword", 2)["processor_ms"]


def test_help_is_printed_by_a_process_of_its_own():
    assert help_ms(tries=1)["processor_ms"] > import_ms("typer", 1)["processor_ms"] / 2
