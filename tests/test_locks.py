"""The lock files: what metanerf runs on, that with Ray, and all with what tests are made with."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
LOCKS = ["requirements.lock", "requirements-cluster.lock", "requirements-dev.lock"]
_PIN = re.compile(r"^([a-z0-9][a-z0-9.-]*)==(\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})*)", re.M)


def pins(lock: str) -> dict[str, tuple[str, int]]:
    """Version and number of hashes of each package of `lock`."""
    found = _PIN.findall((ROOT / lock).read_text())
    return {name: (version, hashes.count("--hash")) for name, version, hashes in found}


def wanted(extra: str | None) -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = project["optional-dependencies"][extra] if extra else project["dependencies"]
    return {Requirement(line).name for line in lines} - {"torch"}


@pytest.mark.parametrize("lock", LOCKS)
def test_every_package_is_pinned_with_hashes_but_torch(lock):
    found = pins(lock)
    assert wanted(None) <= found.keys()
    assert all(hashes for _, hashes in found.values())
    assert "torch" not in found


def test_what_only_tests_need_is_not_downloaded_to_run():
    run, cluster, dev = (pins(lock) for lock in LOCKS)
    assert run.items() <= cluster.items() <= dev.items()
    assert wanted("tracing") <= run.keys()
    assert wanted("cluster") <= cluster.keys() - run.keys()
    assert wanted("dev") <= dev.keys()
    assert {"triton", "anny", "warp-lang", "playwright", "pyright", "pytest"}.isdisjoint(run)
