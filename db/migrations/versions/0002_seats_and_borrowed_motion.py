"""Seats that lapse when nobody sits on them; performers who move by another sequence's motion.

Revision: 0002, after 0001.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

_MOTION = "fk_performer_motion_sequence_id_sequence"


def upgrade() -> None:
    # seats were never given back before: those that are stored belong to nobody any more
    op.execute("DELETE FROM participant")
    with op.batch_alter_table("participant") as table:
        table.add_column(sa.Column("seen_at", sa.DateTime(timezone=True), nullable=False))
    with op.batch_alter_table("performer") as table:
        table.add_column(sa.Column("motion_sequence_id", sa.String(length=32), nullable=True))
        table.create_foreign_key(
            _MOTION, "sequence", ["motion_sequence_id"], ["id"], ondelete="SET NULL"
        )
        table.create_index("ix_performer_motion_sequence_id", ["motion_sequence_id"])


def downgrade() -> None:
    with op.batch_alter_table("performer") as table:
        table.drop_index("ix_performer_motion_sequence_id")
        table.drop_constraint(_MOTION, type_="foreignkey")
        table.drop_column("motion_sequence_id")
    with op.batch_alter_table("participant") as table:
        table.drop_column("seen_at")
