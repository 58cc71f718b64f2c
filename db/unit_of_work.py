"""One database, and transactions on it that undo themselves unless they are committed."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from sqlalchemy import Engine, text
from sqlalchemy.exc import DataError, DBAPIError, IntegrityError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.orm import Session

from db import meeting_repositories, repositories, sql
from db.engine import make_engine
from db.errors import Conflict, DatabaseAway, StoreFull
from db.gateway_sql import SqlGateways
from db.meeting_sql import SqlMeetings
from db.recording_sql import SqlRecordings
from scene.errors import InvalidInput


class Database:
    """The database at one address."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._engine = make_engine(url)

    @property
    def engine(self) -> Engine:
        """The engine, for tools that speak SQL themselves."""
        return self._engine

    def migrate(self, revision: str = "head") -> None:
        """Bring the schema to this version, or up to an earlier `revision`.

        Raises MigrationFailed or DatabaseAway.
        """
        from db.migrations import migrate  # here, for job processes never need it

        try:
            migrate(self._url, revision)
        except OperationalError as error:
            raise _domain_error(error) from error

    def unit_of_work(self) -> SqlUnitOfWork:
        """A transaction that may write."""
        return SqlUnitOfWork(self._engine)

    def reading(self) -> SqlUnitOfWork:
        """A transaction that only reads; on SQLite it waits for no writer."""
        return SqlUnitOfWork(self._engine.execution_options(reads_only=True))

    def ping(self) -> None:
        """Raise DatabaseAway unless the database answers."""
        try:
            with self._engine.execution_options(reads_only=True).connect() as connection:
                connection.execute(text("SELECT 1"))
        except (DBAPIError, PoolTimeout) as error:
            raise _domain_error(error) from error

    def close(self) -> None:
        """Close the pool's connections."""
        self._engine.dispose()


class SqlUnitOfWork:
    """A transaction and its repositories; see `db.repositories.UnitOfWork`."""

    def __init__(self, engine: Engine) -> None:
        # rows stay readable after the end, so that answers are made from plain memory
        self._session = Session(engine, expire_on_commit=False)
        self.people: repositories.People = sql.SqlPeople(self._session)
        self.uploads: repositories.Uploads = sql.SqlUploads(self._session)
        self.sequences: repositories.Sequences = sql.SqlSequences(self._session)
        self.motions: repositories.Motions = sql.SqlMotions(self._session)
        self.models: repositories.Models = sql.SqlModels(self._session)
        self.jobs: repositories.Jobs = sql.SqlJobs(self._session)
        self.meetings: meeting_repositories.Meetings = SqlMeetings(self._session)
        self.gateways: meeting_repositories.Gateways = SqlGateways(self._session)
        self.recordings: meeting_repositories.Recordings = SqlRecordings(self._session)
        self.audit: repositories.AuditLog = sql.SqlAuditLog(self._session)
        self.references: repositories.References = sql.SqlReferences(self._session)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._session.close()  # rolls back what was not committed
        if isinstance(error, (DBAPIError, PoolTimeout)):
            raise _domain_error(error) from error
        if isinstance(error, (UnicodeEncodeError, OverflowError)):
            raise _unfit(str(error)) from error

    def flush(self) -> None:
        """See `repositories.UnitOfWork.flush`."""
        self._session.flush()

    def commit(self) -> None:
        """See `repositories.UnitOfWork.commit`."""
        self._session.commit()


def _domain_error(error: DBAPIError | PoolTimeout) -> Exception:
    """What a database error means to callers; errors that are bugs stay as they are."""
    reason = str(getattr(error, "orig", error)).strip().splitlines()
    first = reason[0] if reason else type(error).__name__
    if isinstance(error, DataError):
        return _unfit(first)
    if isinstance(error, IntegrityError):
        return Conflict(f"the change must fit what is stored; got: {first}; read it again")
    if "disk is full" in first or "No space left" in first:
        return StoreFull(f"the database needs free disk space; got: {first}; free some and retry")
    if isinstance(error, (OperationalError, PoolTimeout)) or error.connection_invalidated:
        return DatabaseAway(f"the database must answer; got: {first}; retry in a moment")
    return error


def _unfit(reason: str) -> InvalidInput:
    """Half a character, a zero character, or a number beyond its column."""
    return InvalidInput(f"text and numbers must fit the database; got: {reason}; correct them")
