"""A migrated database of either kind, empty, for each test."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from db.objects import ObstoreObjects, open_objects
from db.unit_of_work import Database
from tests.servers import DATABASES, fresh_database, make_schema


@pytest.fixture(params=DATABASES)
def url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    with fresh_database(request.param, tmp_path) as address:
        yield address


@pytest.fixture
def database(url: str, empty_database: Path) -> Iterator[Database]:
    made = Database(url)
    make_schema(made, empty_database)
    yield made
    made.close()


@pytest.fixture
def objects(tmp_path: Path) -> ObstoreObjects:
    return open_objects(f"file://{tmp_path / 'objects'}")
