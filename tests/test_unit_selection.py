"""`make unit` needs no server, and what it leaves out is told by fixtures and by a list."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

from tests.servers import SERVER_FIXTURES

ROOT = Path(__file__).resolve().parents[1]
PROBE = """
def pytest_collection_finish(session):
    for item in session.items:
        params = item.callspec.params.values() if hasattr(item, "callspec") else ()
        print("PROBED", item.nodeid, *item.fixturenames, *map(repr, params))
"""
"""A plugin that prints what each selected test asks for."""


def selection() -> str:
    """The marks by which the Makefile selects."""
    found = re.search(
        r'^unit:.*\n\t\$\(PYTEST\) -m "([^"]+)"', (ROOT / "Makefile").read_text(), re.M
    )
    assert found is not None
    return found[1]


def test_what_make_unit_runs_asks_for_no_server(tmp_path: Path):
    (tmp_path / "probe.py").write_text(PROBE)
    collect = ["-m", "pytest", "--collect-only", "-q", "-p", "probe", "-p", "no:cacheprovider"]
    told = subprocess.run(
        [sys.executable, *collect, "-m", selection()],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    probed = [line.split()[1:] for line in told.splitlines() if line.startswith("PROBED")]
    assert len(probed) > 1000
    servers = SERVER_FIXTURES | {"'postgresql'", "'s3'"}
    assert [test for test, *asked in probed if servers & set(asked)] == []
    assert not any(test.startswith("tests/e2e/") for test, *_ in probed)


def test_addresses_of_servers_are_known_in_one_place():
    """So that nobody reaches one without its fixture."""
    addresses = re.compile(r"METANERF_TEST_(POSTGRES|REDIS)|[/@]127\.0\.0\.1:(5432|6379)\b")
    found = [
        path.name for path in (ROOT / "tests").rglob("*.py") if addresses.search(path.read_text())
    ]
    assert found == ["servers.py"]


def test_the_list_of_slow_tests_names_what_is_there():
    listed = (ROOT / "tests" / "slow.txt").read_text().split()
    assert listed == sorted(set(listed))
    for name in listed:
        file, _, test = name.partition("::")
        tree = ast.parse((ROOT / file).read_text("utf-8"))
        functions = (ast.FunctionDef, ast.AsyncFunctionDef)
        names = {one.name for one in tree.body if isinstance(one, functions)}
        assert test in names or not test, name
