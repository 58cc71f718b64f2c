"""All benchmarks in one run that can be cut."""

from __future__ import annotations

import json

import pytest

from benchmarks.catalogue import CATALOGUE, Benchmark
from benchmarks.cli import app
from benchmarks.reporting.checkout import Checkout
from benchmarks.reporting.figures import COMMIT_FIGURES, FiguresFile, FigureWriter
from benchmarks.run_all import chosen, run_all
from scene.errors import InvalidInput
from tests.benchmarks.conftest import commit_all


def no_device() -> None:
    raise InvalidInput("a CUDA device must be at hand; got none; add one")


SERVE, TRAIN, GPU = (
    Benchmark("serve", ("serve",)),
    Benchmark("train", ("train",), takes_backbone=True),
    Benchmark("gpu", ("gpu",), (no_device,)),
)


class Measured:
    """Measures by writing a file, and is interrupted or fails when asked to."""

    def __init__(self, checkout: Checkout) -> None:
        self.checkout = checkout
        self.commands: list[str] = []
        self.cut_at = self.fails_at = ""

    def __call__(self, words: list[str]) -> bool:
        name = words[1]
        if name == self.cut_at:
            self.cut_at = ""
            raise KeyboardInterrupt
        self.commands.append(" ".join(words))
        if name == self.fails_at:
            return False
        commits = COMMIT_FIGURES in words
        FigureWriter.start(name, commits=commits, checkout=self.checkout, words=words).write({})
        return True


def run(measured: Measured, *benchmarks: Benchmark, commits: bool = False) -> bool:
    return run_all(benchmarks, None, commits=commits, checkout=measured.checkout, measure=measured)


def test_a_run_that_was_cut_goes_on(checkout: Checkout):
    measured = Measured(checkout)
    measured.cut_at = "train"
    with pytest.raises(KeyboardInterrupt):
        run(measured, SERVE, TRAIN)
    assert run(measured, SERVE, TRAIN)
    assert measured.commands == ["bench serve", "bench train"]


def test_another_commit_is_measured_anew(checkout: Checkout):
    measured = Measured(checkout)
    run(measured, SERVE)
    (checkout.root / "module.py").write_text("SPEED = 2\n")
    commit_all(checkout.root)
    run(measured, SERVE)
    assert measured.commands == ["bench serve", "bench serve"]


def test_what_is_finished_is_committed_without_another_run(checkout: Checkout):
    measured = Measured(checkout)
    run(measured, SERVE)
    run(measured, SERVE, commits=True)
    assert measured.commands == ["bench serve"]
    assert FiguresFile("serve", checkout).committed.exists()


def test_what_is_not_at_hand_is_skipped_and_keeps_its_figures(checkout: Checkout, capsys):
    committed = FiguresFile("gpu", checkout).committed
    committed.parent.mkdir(parents=True)
    committed.write_text(json.dumps({"date": "2026-01-02T03:04:05+00:00", "commit": "abcdef0"}))
    assert run(Measured(checkout), GPU, SERVE, commits=True)
    told = capsys.readouterr().out
    assert "gpu: skipped: a CUDA device must be at hand; got none" in told
    assert "the pages keep its figures of 2026-01-02T03:04:05+00:00, commit abcdef0" in told
    assert json.loads(committed.read_text())["commit"] == "abcdef0"


def test_one_that_fails_holds_up_no_other(checkout: Checkout, capsys):
    measured = Measured(checkout)
    measured.fails_at = "serve"
    assert not run(measured, SERVE, TRAIN)
    assert measured.commands == ["bench serve", "bench train"]
    assert "serve: failed" in capsys.readouterr().out


def test_a_tree_with_changes_is_refused_before_anything_is_measured(checkout: Checkout):
    (checkout.root / "module.py").write_text("SPEED = 2\n")
    measured = Measured(checkout)
    with pytest.raises(InvalidInput, match=r"without uncommitted changes; got module\.py"):
        run(measured, SERVE, commits=True)
    assert measured.commands == []


def test_names_choose_among_the_benchmarks():
    assert chosen(()) == list(CATALOGUE)
    assert [one.name for one in chosen(["train", "serve"])] == ["train", "serve"]
    with pytest.raises(
        InvalidInput, match=r"a benchmark must be one of reading, live-capture, .*got 'cast'"
    ):
        chosen(["cast"])


def test_every_benchmark_is_a_command():
    commands = {
        command.name or command.callback.__name__
        for command in app.registered_commands
        if command.callback is not None
    }
    assert {one.arguments[0] for one in CATALOGUE} == commands - {"all", "pages"}
