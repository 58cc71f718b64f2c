"""Databases to test on: SQLite always, PostgreSQL where one answers."""

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

POSTGRES = os.environ.get("METANERF_TEST_POSTGRES", "postgresql+psycopg://root@127.0.0.1:5432/test")
REDIS = os.environ.get("METANERF_TEST_REDIS", "redis://127.0.0.1:6379/15")


def unavailable(what: str) -> None:
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
    engine = create_engine(POSTGRES, connect_args={"connect_timeout": 2})
    schema = f"test_{uuid.uuid4().hex[:12]}"
    try:
        with engine.begin() as connection:
            connection.execute(text(f"CREATE SCHEMA {schema}"))
    except OperationalError as error:
        unavailable(f"no PostgreSQL at {POSTGRES} (METANERF_TEST_POSTGRES): {error.orig}")
    url = make_url(POSTGRES).update_query_dict({"options": f"-csearch_path={schema}"})
    try:
        yield url.render_as_string(hide_password=False)
    finally:
        with engine.begin() as connection:
            connection.execute(text(f"DROP SCHEMA {schema} CASCADE"))
        engine.dispose()


def redis_url() -> str:
    """A Redis to test on."""
    import redis

    try:
        redis.Redis.from_url(REDIS, socket_connect_timeout=1).ping()
    except redis.RedisError as error:
        unavailable(f"no Redis at {REDIS} (METANERF_TEST_REDIS): {error}")
    return REDIS
