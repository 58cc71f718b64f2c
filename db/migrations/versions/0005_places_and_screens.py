"""The host's own place, who shares a screen, how well each is connected.

Revision: 0005, after 0004.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("meeting") as table:
        table.add_column(sa.Column("presenter_id", sa.String(length=32), nullable=True))
        table.add_column(sa.Column("presenter_asks_id", sa.String(length=32), nullable=True))
    with op.batch_alter_table("participant") as table:
        table.add_column(sa.Column("connection", sa.String(length=16), nullable=True))
    op.create_table(
        "meeting_panorama",
        sa.Column("meeting_id", sa.String(length=32), nullable=False),
        sa.Column("name", sa.String(length=32), nullable=False),
        sa.Column("picture", sa.LargeBinary(), nullable=False),
        sa.Column("light", sa.JSON(), nullable=False),
        sa.ForeignKeyConstraint(
            ["meeting_id"],
            ["meeting.id"],
            name="fk_meeting_panorama_meeting_id_meeting",
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("meeting_id", name="pk_meeting_panorama"),
    )


def downgrade() -> None:
    op.drop_table("meeting_panorama")
    with op.batch_alter_table("participant") as table:
        table.drop_column("connection")
    with op.batch_alter_table("meeting") as table:
        table.drop_column("presenter_asks_id")
        table.drop_column("presenter_id")
