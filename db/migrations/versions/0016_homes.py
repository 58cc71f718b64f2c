"""Gateways with leases, and the one that each meeting lives on.

Revision: 0016, after 0015.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from db.base import UtcDateTime

revision = "0016"
down_revision = "0015"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "gateway",
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("url", sa.String(255), nullable=False),
        sa.Column("renewed_at", UtcDateTime(), nullable=False),
        sa.Column("free", sa.BigInteger(), nullable=False),
        sa.Column("draining", sa.Boolean(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_gateway"),
    )
    # not in a batch: SQLite would make the table anew, and its dropping takes what hangs on it
    op.add_column("meeting", sa.Column("home_id", sa.String(32)))


def downgrade() -> None:
    op.drop_column("meeting", "home_id")
    op.drop_table("gateway")
