"""Recordings of meetings.

Revision: 0007, after 0006.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

_INDEXES = (
    ("recording", "meeting_id"),
    ("recording", "account"),
    ("recording_member", "account"),
    ("recording_member", "person_id"),
    ("recording_chunk", "person_id"),
    ("recording_chunk", "owner"),
    ("recording_export", "person_id"),
)


def _belongs(table: str, column: str, parent: str) -> sa.ForeignKeyConstraint:
    name = f"fk_{table}_{column}_{parent}"
    return sa.ForeignKeyConstraint([column], [f"{parent}.id"], name=name, ondelete="CASCADE")


def upgrade() -> None:
    op.create_table(
        "recording",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("meeting_id", sa.String(length=32), nullable=False),
        sa.Column("account", sa.String(length=120), nullable=False),
        sa.Column("name", sa.String(length=120), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("asked_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("ended_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("why_ended", sa.String(length=200), nullable=True),
        sa.Column("duration_ms", sa.BigInteger(), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=False),
        _belongs("recording", "meeting_id", "meeting"),
        sa.PrimaryKeyConstraint("id", name="pk_recording"),
    )
    op.create_table(
        "recording_member",
        sa.Column("recording_id", sa.String(length=32), nullable=False),
        sa.Column("participant_id", sa.String(length=32), nullable=False),
        sa.Column("account", sa.String(length=120), nullable=False),
        sa.Column("name", sa.String(length=120), nullable=False),
        sa.Column("agreed", sa.Boolean(), nullable=False),
        sa.Column("performer_id", sa.String(length=32), nullable=True),
        sa.Column("person_id", sa.String(length=32), nullable=True),
        _belongs("recording_member", "recording_id", "recording"),
        _belongs("recording_member", "person_id", "person"),
        sa.PrimaryKeyConstraint("recording_id", "participant_id", name="pk_recording_member"),
    )
    op.create_table(
        "recording_chunk",
        sa.Column("recording_id", sa.String(length=32), nullable=False),
        sa.Column("track", sa.String(length=80), nullable=False),
        sa.Column("number", sa.BigInteger(), nullable=False),
        sa.Column("person_id", sa.String(length=32), nullable=True),
        sa.Column("account", sa.String(length=120), nullable=False),
        sa.Column("owner", sa.String(length=32), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        _belongs("recording_chunk", "recording_id", "recording"),
        _belongs("recording_chunk", "person_id", "person"),
        sa.PrimaryKeyConstraint("recording_id", "track", "number", name="pk_recording_chunk"),
    )
    op.create_table(
        "recording_export",
        sa.Column("recording_id", sa.String(length=32), nullable=False),
        sa.Column("job_id", sa.String(length=32), nullable=False),
        sa.Column("person_id", sa.String(length=32), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        _belongs("recording_export", "recording_id", "recording"),
        _belongs("recording_export", "person_id", "person"),
        sa.PrimaryKeyConstraint("recording_id", "job_id", name="pk_recording_export"),
    )
    for table, column in _INDEXES:
        op.create_index(f"ix_{table}_{column}", table, [column])


def downgrade() -> None:
    for table, column in reversed(_INDEXES):
        op.drop_index(f"ix_{table}_{column}", table)
    for table in ("recording_export", "recording_chunk", "recording_member", "recording"):
        op.drop_table(table)
