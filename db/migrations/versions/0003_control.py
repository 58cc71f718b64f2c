"""Who is let into a meeting and what they may do there, and what they say.

Revision: 0003, after 0002.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("meeting") as table:
        table.add_column(
            sa.Column("lobby", sa.Boolean(), nullable=False, server_default=sa.false())
        )
        table.add_column(sa.Column("ended_at", sa.DateTime(timezone=True), nullable=True))
    with op.batch_alter_table("participant") as table:
        table.add_column(
            sa.Column("role", sa.String(length=16), nullable=False, server_default="speaker")
        )
        table.add_column(
            sa.Column("standing", sa.String(length=16), nullable=False, server_default="admitted")
        )
        table.add_column(sa.Column("heard_at", sa.DateTime(timezone=True), nullable=True))
        table.add_column(sa.Column("hand_at", sa.DateTime(timezone=True), nullable=True))
        table.add_column(
            sa.Column("microphone", sa.Boolean(), nullable=False, server_default=sa.false())
        )
    op.create_table(
        "meeting_message",
        sa.Column("meeting_id", sa.String(length=32), nullable=False),
        sa.Column("number", sa.BigInteger(), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("participant_id", sa.String(length=32), nullable=False),
        sa.Column("name", sa.String(length=120), nullable=False),
        sa.Column("text", sa.String(length=2000), nullable=False),
        sa.Column("at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["meeting_id"],
            ["meeting.id"],
            name="fk_meeting_message_meeting_id_meeting",
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("meeting_id", "number", name="pk_meeting_message"),
    )


def downgrade() -> None:
    op.drop_table("meeting_message")
    with op.batch_alter_table("participant") as table:
        for column in ("microphone", "hand_at", "heard_at", "standing", "role"):
            table.drop_column(column)
    with op.batch_alter_table("meeting") as table:
        table.drop_column("ended_at")
        table.drop_column("lobby")
