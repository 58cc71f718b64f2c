"""Where a meeting is held: the theme of its room.

Revision: 0004, after 0003.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("meeting") as table:
        table.add_column(
            sa.Column("environment", sa.String(length=32), nullable=False, server_default="studio")
        )


def downgrade() -> None:
    with op.batch_alter_table("meeting") as table:
        table.drop_column("environment")
