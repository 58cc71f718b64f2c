"""Whose seat it is, who may not come back; frames that go once a model is there.

Revision: 0006, after 0005.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("participant") as table:
        table.add_column(
            sa.Column("account", sa.String(length=120), nullable=False, server_default="")
        )
    with op.batch_alter_table("sequence") as table:
        table.add_column(
            sa.Column("model_only", sa.Boolean(), nullable=False, server_default=sa.false())
        )
    op.create_table(
        "meeting_ban",
        sa.Column("meeting_id", sa.String(length=32), nullable=False),
        sa.Column("account", sa.String(length=120), nullable=False),
        sa.Column("at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["meeting_id"],
            ["meeting.id"],
            name="fk_meeting_ban_meeting_id_meeting",
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("meeting_id", "account", name="pk_meeting_ban"),
    )


def downgrade() -> None:
    op.drop_table("meeting_ban")
    with op.batch_alter_table("sequence") as table:
        table.drop_column("model_only")
    with op.batch_alter_table("participant") as table:
        table.drop_column("account")
