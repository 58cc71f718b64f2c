"""Where figures go, what they say of their origin, and when they may be committed."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest

from benchmarks.reporting.checkout import Checkout
from benchmarks.reporting.figures import FiguresFile, FigureWriter, command_line
from scene.errors import InvalidInput
from tests.benchmarks.conftest import commit_all, git

WORDS = ["bench", "serve", "--commit-figures"]
NOON = datetime(2026, 5, 1, 14, 0, tzinfo=timezone(timedelta(hours=2)))


def start(checkout: Checkout, *, commits: bool = False) -> FigureWriter:
    return FigureWriter.start("serve", commits=commits, checkout=checkout, words=WORDS, now=NOON)


def test_figures_say_where_they_come_from(checkout: Checkout):
    start(checkout).write({"frames_per_second": 30.0})
    assert not (checkout.root / "docs" / "figures").exists()
    figures = json.loads((checkout.root / "build" / "figures" / "serve.json").read_text())
    assert figures["benchmark"] == "serve"
    assert figures["command"] == "metanerf bench serve"
    assert figures["date"] == "2026-05-01T12:00:00+00:00"
    machine = {"processor", "cores", "load_before", "loop_ms", "python", "torch"}
    assert set(figures["machine"]) == machine
    assert figures["commit"] == git(checkout.root, "rev-parse", "HEAD")[:7]
    assert figures["uncommitted_changes"] is False
    assert figures["frames_per_second"] == 30.0


def test_the_clock_is_the_machines_unless_one_is_given(checkout: Checkout):
    before = datetime.now(UTC).replace(microsecond=0)
    writer = FigureWriter.start("serve", checkout=checkout, words=WORDS)
    assert before <= datetime.fromisoformat(writer.origin["date"]) <= datetime.now(UTC)


def test_a_command_tells_no_folders_of_the_machine():
    words = ["bench", "train", "--backbone", "/home/ada/squeeze.pth", "--commit-figures"]
    assert command_line(words) == "metanerf bench train --backbone squeeze.pth"


@pytest.mark.parametrize("name", ["module.py", "new.py"])
def test_figures_of_a_tree_with_changes_are_not_committed(checkout: Checkout, name: str):
    (checkout.root / name).write_text("SPEED = 2\n")
    rule = "must come from a tree without uncommitted changes"
    with pytest.raises(InvalidInput, match=rf"{rule}; got {re.escape(name)}; commit or stash"):
        start(checkout, commits=True)
    writer = start(checkout)
    writer.write({})
    assert json.loads(writer.file.built.read_text())["uncommitted_changes"] is True


def test_outside_of_a_checkout_nothing_is_committed(tmp_path: Path):
    with pytest.raises(InvalidInput, match="must be given in a git checkout; got"):
        start(Checkout(tmp_path), commits=True)
    assert start(Checkout(tmp_path)).origin["commit"] is None


def test_figures_and_pages_that_changed_do_not_make_a_tree_dirty(checkout: Checkout):
    for run in range(2):
        writer = start(checkout, commits=True)
        writer.write({"run": run})
        assert json.loads(writer.file.committed.read_text())["run"] == run
    (checkout.root / "docs" / "page.md").write_text("Another page.\n")
    start(checkout, commits=True)


def test_a_tree_that_changes_while_it_is_measured_is_not_committed(checkout: Checkout):
    changed, moved = start(checkout, commits=True), start(checkout, commits=True)
    (checkout.root / "module.py").write_text("SPEED = 2\n")
    with pytest.raises(InvalidInput, match=r"without uncommitted changes; got module\.py"):
        changed.write({})
    commit_all(checkout.root)
    with pytest.raises(InvalidInput, match=r"must come from one commit; got \w{7} at the start"):
        moved.write({})
    assert moved.file.built.exists()
    assert not moved.file.committed.exists()


def test_figures_are_finished_for_the_code_and_the_command_that_made_them(checkout: Checkout):
    file, command = FiguresFile("serve", checkout), "metanerf bench serve"
    assert not file.finished(command)
    start(checkout).write({})
    assert file.finished(command)
    assert not file.finished(f"{command} --quick")

    (checkout.root / "docs" / "page.md").write_text("Another page.\n")
    commit_all(checkout.root)
    assert file.finished(command)  # no figure depends on pages

    (checkout.root / "module.py").write_text("SPEED = 2\n")
    assert not file.finished(command)
    commit_all(checkout.root)
    assert not file.finished(command)


def test_measurements_are_stored_by_commit(checkout: Checkout):
    first = start(checkout).cache()
    (checkout.root / "module.py").write_text("SPEED = 2\n")
    changed = start(checkout).cache()
    commit_all(checkout.root)
    second = start(checkout).cache()
    assert len({first.folder, changed.folder, second.folder}) == 3
    assert git(checkout.root, "status", "--porcelain") == ""
