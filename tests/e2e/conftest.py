"""One demo's server for all tests that need no other: each opens a meeting of its own."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import expect

from benchmarks.browser import running_demo

expect.set_options(timeout=30_000)  # ms, for a machine that does much else


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a demo that runs as long as the tests."""
    with running_demo(tmp_path_factory.mktemp("demo") / "data") as address:
        yield address
