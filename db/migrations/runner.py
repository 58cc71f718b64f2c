"""Brings a database to this version's schema; several processes may try at once."""

from __future__ import annotations

import fcntl
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from sqlite3 import Connection as SqliteConnection

from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from alembic.util import CommandError
from sqlalchemy import Connection, Engine, event, text

from db.engine import make_engine
from db.errors import MigrationFailed

_LOCK_KEY = 0x4D65_7461_4E65_5246
"""Key of the advisory lock on PostgreSQL: "MetaNeRF" in ASCII."""


def head() -> str:
    """The revision that this version of the program works with."""
    found = ScriptDirectory(str(Path(__file__).parent)).get_current_head()
    assert found is not None
    return found


def migrate(url: str, revision: str = "head") -> None:
    """Bring the database at `url` up to `revision`; one process at a time, the others wait.

    Raises MigrationFailed, for instance on a database that a newer version has written.
    """
    _run(url, lambda config: command.upgrade(config, revision))


def downgrade(url: str, revision: str) -> None:
    """Take the database at `url` back to `revision` ("base": empty)."""
    _run(url, lambda config: command.downgrade(config, revision))


def check(url: str) -> None:
    """Raise MigrationFailed unless the database at `url` is what the models describe."""
    _run(url, command.check)


def _run(url: str, action) -> None:
    engine = make_engine(url)
    if engine.dialect.name == "sqlite":
        event.listen(engine, "connect", _let_tables_be_replaced)
    try:
        with _only_one(engine), engine.connect() as connection:
            config = Config(stdout=io.StringIO())
            config.set_main_option("script_location", str(Path(__file__).parent))
            config.attributes["connection"] = connection
            action(config)
            connection.commit()
    except CommandError as error:
        shown = engine.url.render_as_string(hide_password=True)
        raise MigrationFailed(
            f"the schema of {shown} must be one this version knows; got: {error}; "
            "start the newer version, or restore a backup"
        ) from error
    finally:
        engine.dispose()


def _let_tables_be_replaced(connection: SqliteConnection, _record: object) -> None:
    """A table that SQLite can't alter is made anew, and dropping the old one would take the rows
    that hang on it (sqlite.org/lang_altertable, section 7)."""
    connection.execute("PRAGMA foreign_keys=OFF")


@contextmanager
def _only_one(engine: Engine) -> Iterator[None]:
    if engine.dialect.name == "postgresql":
        # the lock is the session's: it waits in no transaction
        alone = engine.execution_options(isolation_level="AUTOCOMMIT")
        with alone.connect() as connection, _advisory_lock(connection):
            yield
        return
    with Path(f"{engine.url.database}.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@contextmanager
def _advisory_lock(connection: Connection) -> Iterator[None]:
    connection.execute(text("SELECT pg_advisory_lock(:key)"), {"key": _LOCK_KEY})
    try:
        yield
    finally:
        connection.execute(text("SELECT pg_advisory_unlock(:key)"), {"key": _LOCK_KEY})
