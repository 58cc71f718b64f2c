"""All benchmarks, one after the other, in a run that can be cut and gone on with."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

from benchmarks.catalogue import CATALOGUE, Benchmark
from benchmarks.reporting.checkout import Checkout
from benchmarks.reporting.figures import COMMIT_FIGURES, FiguresFile, command_line, require_clean
from scene.errors import InvalidInput

Measure = Callable[[list[str]], bool]
"""Runs a command line, given without `metanerf`; whether it went well."""


def chosen(names: Iterable[str]) -> list[Benchmark]:
    """The benchmarks of these names, all where there are none.

    Raises InvalidInput where a name is nobody's.
    """
    known = {one.name: one for one in CATALOGUE}
    if unknown := [name for name in names if name not in known]:
        raise InvalidInput(
            f"a benchmark must be one of {', '.join(known)}; got {unknown[0]!r}; leave names out "
            "for all of them"
        )
    return [known[name] for name in names] or list(CATALOGUE)


def run_all(
    benchmarks: Iterable[Benchmark],
    backbone: Path | None,
    *,
    commits: bool,
    checkout: Checkout,
    measure: Measure,
) -> bool:
    """Measure what the present commit has no finished figures of; whether none failed.

    Raises InvalidInput where figures are to be committed and the tree is not clean.
    """
    if commits:
        require_clean(checkout)
    well = True
    for benchmark in benchmarks:
        outcome = _run(benchmark, backbone, commits, checkout, measure)
        well = well and outcome != _FAILED
        print(f"{benchmark.name}: {outcome}", flush=True)
    return well


_FAILED = "failed"


def _run(
    benchmark: Benchmark, backbone: Path | None, commits: bool, checkout: Checkout, measure: Measure
) -> str:
    file, words = FiguresFile(benchmark.name, checkout), benchmark.words(backbone)
    if file.finished(command_line(words)):
        if commits:
            file.commit_built()
        return f"measured at this code already ({file.built})"
    if (missing := benchmark.missing()) is not None:
        return f"skipped: {missing}{_still(file)}"
    return "measured" if measure([*words, COMMIT_FIGURES] if commits else words) else _FAILED


def _still(file: FiguresFile) -> str:
    """What the pages go on showing."""
    if not file.committed.exists():
        return ""
    figures = json.loads(file.committed.read_text())
    return f"; the pages keep its figures of {figures['date']}, commit {figures['commit']}"


def in_process_of_its_own(checkout: Checkout) -> Measure:
    """Each benchmark sets its own numbers of threads, and leaves no memory behind."""

    def measure(words: list[str]) -> bool:
        command = [sys.executable, "-m", "services.cli", *words]
        return subprocess.run(command, cwd=checkout.root, check=False).returncode == 0

    return measure
