"""Checks array annotations of scene/ and renderer/ while testing; marks who asks for a server.

Modules of numba code (`*kernels`) are left out: a compiled function can't be wrapped.
"""

from __future__ import annotations

import scene  # noqa: F401 - says how threads wait, before numpy is first imported

# isort: split
import os
import pkgutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import jaxtyping
import pytest
import torch
from hypothesis import settings

import tests.annotations  # noqa: F401  (the hook finds its checker by this name)
from tests.servers import SERVER_FIXTURES
from tests.servers import empty_database as empty_database
from tests.servers import face_model as face_model
from tests.servers import hand_model as hand_model
from tests.servers import mortal_redis as mortal_redis
from tests.servers import pose_model as pose_model
from tests.servers import postgres_url as postgres_url
from tests.servers import redis_url as redis_url
from tests.servers import s3_endpoint as s3_endpoint
from tests.servers import turn_server as turn_server

# before anything imports triton: without a GPU its kernels run one by one on the CPU
if not torch.cuda.is_available():
    os.environ.setdefault("TRITON_INTERPRET", "1")

_ROOT = Path(__file__).resolve().parents[1]


def _checked_modules() -> list[str]:
    names = []
    for package in ("scene", "renderer"):
        found = pkgutil.walk_packages([str(_ROOT / package)], prefix=f"{package}.")
        names += [m.name for m in found if not m.ispkg and not m.name.endswith("kernels")]
    return names


jaxtyping.install_import_hook(_checked_modules(), "tests.annotations.typecheck")


# an example takes as long as the machine is busy
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

_SLOW = frozenset(Path(__file__).with_name("slow.txt").read_text().split())


@pytest.fixture
def fewer_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits of captures take 270 steps instead of 740: enough for known people who hold still or
    nearly so, and for whoever asks little of a capture."""
    monkeypatch.setattr("capture.fitting.fit.LANDMARK_STEPS", 150)
    monkeypatch.setattr("capture.fitting.fit.SILHOUETTE_STEPS", 60)


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark what needs a server, by its fixtures, and what takes long, by the list of it."""
    assert isinstance(item, pytest.Function)
    if not SERVER_FIXTURES.isdisjoint(item.fixturenames):
        item.add_marker(pytest.mark.server)
    test = item.nodeid.partition("[")[0]
    if not _SLOW.isdisjoint({test, test.partition("::")[0]}):
        item.add_marker(pytest.mark.slow)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take long, so that of two workers none ends alone with one."""
    files = {name.partition("::")[0] for name in _SLOW}

    def place(item: pytest.Item) -> int:
        file = item.nodeid.partition("::")[0]
        return 0 if file in _SLOW else 1 if file in files else 2

    items.sort(key=place)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Leave the checker of annotations out of slow tests, a fifth of whose time it would take.

    Quick tests call the same functions, and check them. Fixtures of wider scopes are left out
    with the test that sets them up.
    """
    if item.get_closest_marker("slow") is None:
        return (yield)
    with _unchecked():
        return (yield)


@contextmanager
def _unchecked() -> Generator[None, None, None]:
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        jaxtyping.config.update("jaxtyping_disable", before)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Where everything that tests need was started first, as in CI, a skip is a failure."""
    report = yield
    if (
        report.skipped
        and os.environ.get("METANERF_TEST_NO_SKIPS")
        and not hasattr(report, "wasxfail")
    ):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
        report.outcome = "failed"
        report.longrepr = f"skipped where nothing may be skipped: {reason}"
    return report


@pytest.fixture
def unchecked_annotations():
    """For tests of the errors a user sees, who runs without the checker."""
    with _unchecked():
        yield
