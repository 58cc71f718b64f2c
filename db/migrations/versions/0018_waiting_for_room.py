"""Jobs that wait for room on a full disk.

Revision: 0018, after 0017.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from db.base import UtcDateTime

revision = "0018"
down_revision = "0017"


def upgrade() -> None:
    """Nothing waits yet."""
    op.add_column("job", sa.Column("not_before", UtcDateTime()))
    op.add_column(
        "job", sa.Column("full_disks", sa.BigInteger(), nullable=False, server_default="0")
    )


def downgrade() -> None:
    """What waits is tried at once."""
    op.drop_column("job", "full_disks")
    op.drop_column("job", "not_before")
