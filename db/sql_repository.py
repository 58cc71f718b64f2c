"""What repositories on SQLAlchemy share."""

from __future__ import annotations

from typing import TypeVar

from sqlalchemy.orm import Session

from db.base import Base
from db.errors import NotFound

Row = TypeVar("Row", bound=Base)


class SqlRepository:
    """Rows of one transaction."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def _get(self, kind: type[Row], key: str, noun: str, *, locked: bool = False) -> Row:
        row = self._session.get(kind, key, with_for_update=locked)
        if row is None:
            raise NotFound(
                f"id must be that of a {noun}; got {key!r}; list them to see what exists"
            )
        return row
