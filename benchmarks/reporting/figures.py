"""The file of a benchmark's figures, and where they come from.

Every benchmark writes `build/figures/NAME.json`, which git ignores. `--commit-figures` also writes
`docs/figures/NAME.json`, from which the pages are made, and asks for a tree without changes: a
committed figure can be measured again.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from benchmarks.reporting.checkout import Checkout
from benchmarks.reporting.measurements import MeasurementCache
from benchmarks.reporting.origin import origin_of
from scene.errors import InvalidInput

COMMIT_FIGURES = "--commit-figures"
_BUILT, _COMMITTED = Path("build/figures"), Path("docs/figures")
_MEASUREMENTS = Path("build/measurements")


@dataclass(frozen=True)
class FiguresFile:
    """The figures of the benchmark `name`, in one checkout."""

    name: str
    checkout: Checkout = Checkout()  # noqa: RUF009 (frozen)

    @property
    def built(self) -> Path:
        """Where they were measured last."""
        return self.checkout.root / _BUILT / f"{self.name}.json"

    @property
    def committed(self) -> Path:
        """What the pages show."""
        return self.checkout.root / _COMMITTED / f"{self.name}.json"

    @property
    def pictures(self) -> Path:
        """Folder of the pictures that were drawn last."""
        return self.built.with_suffix("")

    def finished(self, command: str) -> bool:
        """What was measured last is what `command` would measure now."""
        if not self.built.exists() or self.checkout.uncommitted_paths():
            return False
        figures = json.loads(self.built.read_text())
        return (
            figures["command"] == command
            and not figures["uncommitted_changes"]
            and self.checkout.measures_the_same(figures["commit"])
        )

    def commit_built(self) -> None:
        """Put what was measured and drawn last where the pages take it from."""
        _write(self.committed, self.built.read_text())
        for picture in sorted(self.pictures.glob("*")):
            kept = self.committed.with_suffix("") / picture.name
            kept.parent.mkdir(exist_ok=True)
            kept.write_bytes(picture.read_bytes())


@dataclass(frozen=True)
class FigureWriter:
    """One run of a benchmark, from before it measures until its figures are written."""

    file: FiguresFile
    origin: dict[str, Any]
    commits: bool
    """Its figures go to the pages too."""

    @classmethod
    def start(
        cls,
        name: str,
        *,
        commits: bool = False,
        checkout: Checkout | None = None,
        words: Sequence[str] | None = None,
        now: datetime | None = None,
    ) -> FigureWriter:
        """Note where the figures `name` come from, before anything is measured.

        Args:
            commits: the pages are to show them.
            words: what the command line was given; None: what this process was given.
            now: None: the machine's clock.

        Raises InvalidInput where they are to be committed and the tree is not clean.
        """
        checkout = checkout or Checkout()
        if commits:
            require_clean(checkout)
        command = command_line(sys.argv[1:] if words is None else words)
        origin = {"command": command, **origin_of(checkout, now)}
        return cls(FiguresFile(name, checkout), origin, commits)

    @property
    def measurements(self) -> Path:
        """Folder for what outlives a cut, of this commit alone."""
        commit = self.origin["commit"] or "unknown"
        tree = f"{commit}-changed" if self.origin["uncommitted_changes"] else commit
        return self.file.checkout.root / _MEASUREMENTS / self.file.name / tree

    def picture(self, name: str) -> Path:
        """Where a picture that goes with the figures is to be drawn."""
        return self.file.pictures / name

    def cache(self, only: str = "") -> MeasurementCache:
        """What this benchmark has measured of this commit; `only`: see there."""
        return MeasurementCache(self.measurements, only, self.file.checkout)

    def write(self, figures: dict[str, Any]) -> None:
        """Write the file whole or not at all, and say where.

        Raises InvalidInput where the tree has changed since the start; what was measured is kept
        for this machine, but not committed.
        """
        report = {"benchmark": self.file.name, **self.origin, **figures}
        _write(self.file.built, json.dumps(report, indent=1) + "\n")
        print(f"figures: {self.file.built}")
        if self.commits:
            require_clean(self.file.checkout, since=self.origin["commit"])
            self.file.commit_built()
            print(f"figures: {self.file.committed}")


def require_clean(checkout: Checkout, since: str | None = None) -> None:
    """Raises InvalidInput where code has uncommitted changes, or is no longer that of `since`."""
    mend = f"commit or stash them, or measure without {COMMIT_FIGURES}"
    if checkout.commit() is None:
        raise InvalidInput(
            f"{COMMIT_FIGURES} must be given in a git checkout; got {checkout.root}; clone the "
            f"repository, or measure without {COMMIT_FIGURES}"
        )
    if changed := checkout.uncommitted_paths():
        shown = ", ".join(changed[:3]) + (f" and {len(changed) - 3} more" if changed[3:] else "")
        raise InvalidInput(
            f"committed figures must come from a tree without uncommitted changes; got {shown}; "
            + mend
        )
    if since is not None and not checkout.measures_the_same(since):
        raise InvalidInput(
            f"committed figures must come from one commit; got {since} at the start and "
            f"{checkout.commit()} at the end; measure again"
        )


def command_line(words: Sequence[str]) -> str:
    """The command that measures the same again; a file's folder is one machine's business."""
    shown = [Path(word).name if word.startswith("/") else word for word in words]
    return " ".join(["metanerf", *(word for word in shown if word != COMMIT_FIGURES)])


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(text)
    part.replace(path)
