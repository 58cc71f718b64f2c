"""Engines for SQLite (the default, write-ahead log) and PostgreSQL.

SQLite: pysqlite's own transaction handling is switched off, and transactions that may write begin
IMMEDIATE. A deferred one that turns writer after another has written would fail at once with
"database is locked", whatever the busy timeout (sqlite.org/lang_transaction.html, section 2.2).

PostgreSQL: whoever hangs in the middle of a transaction loses it, with the locks that others wait
for. A stopped process would else hold up every job there is.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from sqlite3 import Connection as SqliteConnection

from psycopg import Connection as PostgresConnection
from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import make_url

PATIENCE_MS = 15_000
"""How long others wait for a transaction in which nothing happens."""
_CONNECT_TIMEOUT_S = 3
"""A database that is away must be noticed while somebody still waits for the answer."""


def make_engine(url: str) -> Engine:
    """An engine for `url`. The folder of an SQLite file is made where it is missing."""
    parsed = make_url(url)
    if parsed.get_backend_name() != "sqlite":
        engine = create_engine(
            parsed,
            pool_pre_ping=True,
            pool_size=10,
            max_overflow=20,
            pool_timeout=10,
            connect_args={"connect_timeout": _CONNECT_TIMEOUT_S},
            json_serializer=_strict_json,
        )
        event.listen(engine, "connect", _prepare_postgres)
        return engine
    Path(str(parsed.database)).parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(parsed, pool_timeout=30, json_serializer=_strict_json)
    event.listen(engine, "connect", _prepare_sqlite)
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def _strict_json(value: object) -> str:
    # NaN is no JSON: PostgreSQL would refuse it, and so would browsers
    try:
        return json.dumps(value, allow_nan=False)
    except ValueError:
        return json.dumps(_nan_to_null(value), allow_nan=False)


def _nan_to_null(value: object) -> object:
    if isinstance(value, dict):
        return {key: _nan_to_null(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_nan_to_null(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _prepare_postgres(connection: PostgresConnection, _record: object) -> None:
    setting = ("idle_in_transaction_session_timeout", str(PATIENCE_MS))
    connection.execute("SELECT set_config(%s, %s, false)", setting)
    connection.commit()


def _prepare_sqlite(connection: SqliteConnection, _record: object) -> None:
    connection.isolation_level = None
    for pragma in (
        f"busy_timeout={PATIENCE_MS}",
        "journal_mode=WAL",
        "synchronous=NORMAL",
        "foreign_keys=ON",
        "secure_delete=ON",
    ):
        connection.execute(f"PRAGMA {pragma}")


def _begin_sqlite(connection: Connection) -> None:
    reads = connection.get_execution_options().get("reads_only", False)
    connection.exec_driver_sql("BEGIN" if reads else "BEGIN IMMEDIATE")
