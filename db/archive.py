"""The format of a backup: one tar with every row, but for leases of gateways, and every object that
a row names.

| entry | what |
| --- | --- |
| `rows/TABLE.jsonl` | a JSON object a row, by column; what JSON has no type for is an object of one field: `time` (ISO 8601, UTC), `bytes` (base64), `json` (a JSON column's value) |
| `objects/OWNER/SHA256` | an object's bytes |
| `manifest.json` | the last entry, without which an archive is half: schema, moment, counts, hashes |
"""  # noqa: E501

from __future__ import annotations

import base64
import json
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import JSON, Row, Table

from db.errors import BrokenArchive

FORMAT, VERSION = "metanerf-backup", 1
MANIFEST = "manifest.json"
ROWS, OBJECTS = "rows/", "objects/"
_UNREADABLE = (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError)
"""What JSON that is none, or another than ours, leads to."""
LEASES = "gateway"
"""The table that no archive holds: its rows are of the moment."""


@dataclass(frozen=True)
class Manifest:
    """What an archive holds, and until when it may be kept."""

    revision: str
    """Of the schema."""
    made_at: str
    """ISO 8601."""
    forget_by: str
    """ISO 8601: from then on, who was erased meanwhile must not come back by it."""
    rows: dict[str, int]
    """Rows by table."""
    hashes: dict[str, str]
    """sha256 of each table's entry."""
    objects: int
    bytes: int
    """Of all objects."""
    lost: tuple[str, ...]
    """`OWNER/SHA256` of objects that a row names and the store did not have whole."""

    def to_json(self) -> bytes:
        """As the archive has it."""
        about = {"format": FORMAT, "version": VERSION}
        return json.dumps(about | asdict(self), indent=1).encode()

    @classmethod
    def from_json(cls, data: bytes) -> Manifest:
        """The inverse. Raises BrokenArchive."""
        try:
            about = json.loads(data)
            found = (about.pop("format"), about.pop("version"))
            if found != (FORMAT, VERSION):
                raise BrokenArchive(f"an archive must be {FORMAT} {VERSION}; got {found}")
            manifest = cls(**about | {"lost": tuple(about["lost"])})
            # one without a zone could not be compared
            if datetime.fromisoformat(manifest.forget_by).tzinfo is None:
                raise BrokenArchive(f"forget_by must have a zone; got {manifest.forget_by}")
            if not isinstance(manifest.revision, str):
                raise BrokenArchive(f"revision must be a text; got {manifest.revision!r}")
            return manifest
        except _UNREADABLE as error:
            raise BrokenArchive(f"{MANIFEST} must describe an archive; got {error!r}") from error


def encode_row(table: Table, row: Row[Any]) -> bytes:
    """A row as a line."""
    values = dict(row._mapping)
    told = {
        column.name: _encode(values[column.name], isinstance(column.type, JSON))
        for column in table.columns
        if values[column.name] is not None
    }
    return json.dumps(told, separators=(",", ":")).encode() + b"\n"


def decode_row(line: bytes) -> dict[str, Any]:
    """The values of a line by column; those that are empty are left out. Raises BrokenArchive."""
    try:
        return {name: _decode(value) for name, value in json.loads(line).items()}
    except _UNREADABLE as error:
        raise BrokenArchive(f"a row must be a JSON object; got {error}") from error


def _encode(value: Any, is_json: bool) -> Any:
    if is_json:
        return {"json": value}
    if isinstance(value, datetime):
        # SQLite stores no time zone: what has none is UTC
        return {"time": (value if value.tzinfo else value.replace(tzinfo=UTC)).isoformat()}
    if isinstance(value, bytes):
        return {"bytes": base64.b64encode(value).decode()}
    return value


def _decode(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    ((kind, inner),) = value.items()
    if kind == "time":
        return datetime.fromisoformat(inner).astimezone(UTC)
    return base64.b64decode(inner) if kind == "bytes" else inner
