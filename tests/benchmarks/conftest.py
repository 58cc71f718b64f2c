"""A checkout of its own: a real git repository with one module and one page."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from benchmarks.reporting.checkout import Checkout


def git(root: Path, *words: str) -> str:
    identity = ("-c", "user.name=test", "-c", "user.email=test@example.org")
    command = ["git", "-C", str(root), *identity, *words]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def commit_all(root: Path) -> None:
    git(root, "add", "--all")
    git(root, "commit", "--quiet", "--message", "change")


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    root = tmp_path / "checkout"
    (root / "docs").mkdir(parents=True)
    git(root.parent, "init", "--quiet", str(root))
    (root / ".gitignore").write_text("/build/\n")
    (root / "module.py").write_text("SPEED = 1\n")
    (root / "docs" / "page.md").write_text("A page.\n")
    commit_all(root)
    return Checkout(root)
