"""Errors of rows and objects.

SceneError
└── DatabaseError
    ├── NotFound          no row or object of that id
    ├── Conflict          the change contradicts what is stored
    ├── StoreFull         no space left for bytes
    ├── StoreAway         the object store doesn't answer
    ├── DatabaseAway      the database doesn't answer
    ├── MigrationFailed   the schema can't be brought to this version
    ├── BrokenArchive     half a backup, or a damaged one
    └── ArchiveExpired    a backup that was to be forgotten
"""

from __future__ import annotations

from scene.errors import SceneError


class DatabaseError(SceneError):
    """Root of the errors of this package."""


class NotFound(DatabaseError):
    """There is no row or object of that id."""


class Conflict(DatabaseError):
    """The change contradicts what is stored."""


class StoreFull(DatabaseError):
    """No space is left for bytes."""


class StoreAway(DatabaseError):
    """The object store does not answer."""


class DatabaseAway(DatabaseError):
    """The database does not answer."""


class MigrationFailed(DatabaseError):
    """The schema can't be brought to this version."""


class BrokenArchive(DatabaseError):
    """An archive is half, damaged, or none."""


class ArchiveExpired(DatabaseError):
    """An archive was to be forgotten before now."""
