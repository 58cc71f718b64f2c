"""What tests ask of the machine beyond their own process: PostgreSQL, Redis, files of the network.

Whatever asks for one of these fixtures, or for `POSTGRESQL` of `DATABASES`, is marked `server`
(tests/conftest.py), and `make unit` leaves it out.
"""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import OperationalError

from capture.detection.network_files import FACE_MODEL, HAND_MODEL, POSE_MODEL
from tests.landmark_models import landmark_model

_POSTGRES = os.environ.get(
    "METANERF_TEST_POSTGRES", "postgresql+psycopg://root@127.0.0.1:5432/test"
)
_REDIS = os.environ.get("METANERF_TEST_REDIS", "redis://127.0.0.1:6379/15")
POSTGRESQL = pytest.param("postgresql", marks=pytest.mark.server)
DATABASES = ("sqlite", POSTGRESQL)
"""Kinds of databases to test on: SQLite always, PostgreSQL where one answers."""
SERVER_FIXTURES = frozenset({"postgres_url", "redis_url", "pose_model", "face_model", "hand_model"})


def _unavailable(what: str) -> None:
    """Skip for want of a server, unless skips are forbidden."""
    if os.environ.get("METANERF_TEST_NO_SKIPS"):
        pytest.fail(what)
    pytest.skip(what)


@contextmanager
def fresh_database(kind: str, folder: Path) -> Iterator[str]:
    """The URL of an empty database: a file, or a schema of its own on PostgreSQL."""
    if kind == "sqlite":
        yield f"sqlite:///{folder / 'metanerf.db'}"
        return
    engine = create_engine(_POSTGRES, connect_args={"connect_timeout": 2})
    schema = f"test_{uuid.uuid4().hex[:12]}"
    try:
        with engine.begin() as connection:
            connection.execute(text(f"CREATE SCHEMA {schema}"))
    except OperationalError as error:
        _unavailable(f"no PostgreSQL at {_POSTGRES} (METANERF_TEST_POSTGRES): {error.orig}")
    url = make_url(_POSTGRES).update_query_dict({"options": f"-csearch_path={schema}"})
    try:
        yield url.render_as_string(hide_password=False)
    finally:
        with engine.begin() as connection:
            connection.execute(text(f"DROP SCHEMA {schema} CASCADE"))
        engine.dispose()


@pytest.fixture
def postgres_url(tmp_path: Path) -> Iterator[str]:
    """An empty schema of a PostgreSQL."""
    with fresh_database("postgresql", tmp_path) as url:
        yield url


@pytest.fixture(scope="session")
def redis_url() -> str:
    """A Redis to test on."""
    import redis

    try:
        redis.Redis.from_url(_REDIS, socket_connect_timeout=1).ping()
    except redis.RedisError as error:
        _unavailable(f"no Redis at {_REDIS} (METANERF_TEST_REDIS): {error}")
    return _REDIS


@pytest.fixture(scope="session")
def pose_model() -> Path:
    """MediaPipe's network for landmarks of the body."""
    return landmark_model(POSE_MODEL)


@pytest.fixture(scope="session")
def face_model() -> Path:
    """MediaPipe's network for faces."""
    return landmark_model(FACE_MODEL)


@pytest.fixture(scope="session")
def hand_model() -> Path:
    """MediaPipe's network for hands."""
    return landmark_model(HAND_MODEL)
