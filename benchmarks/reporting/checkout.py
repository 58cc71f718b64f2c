"""The commit that a benchmark measures, as git tells it."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_MEASURED = (".", ":!docs", ":!tests", ":!*.md")
"""What a figure depends on, as git's pathspecs: figures may be committed without being outdated."""


@dataclass(frozen=True)
class Checkout:
    """The working tree in `root`, which need not be one: then no commit is known."""

    root: Path = ROOT

    def commit(self) -> str | None:
        """Seven or more hexadecimal digits; None outside of a git checkout."""
        return self._git("rev-parse", "--short=7", "HEAD")

    def uncommitted_paths(self) -> list[str]:
        """Changed and new files that a figure may depend on; not those that git ignores."""
        status = self._git("status", "--porcelain", "--untracked-files=all", "--", *_MEASURED)
        return [line.strip().partition(" ")[2].strip() for line in (status or "").splitlines()]

    def measures_the_same(self, commit: str) -> bool:
        """Nothing that a figure may depend on has changed from `commit` to the present one."""
        return self._git("diff", "--quiet", commit, "HEAD", "--", *_MEASURED) is not None

    def _git(self, *words: str) -> str | None:
        """What git says; None where it fails."""
        done = subprocess.run(
            ["git", "-C", str(self.root), *words], capture_output=True, text=True, check=False
        )
        return done.stdout.rstrip() if done.returncode == 0 else None
