"""Performers that somebody invited brought along, with whom they go.

Revision: 0017, after 0016.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0017"
down_revision = "0016"


def upgrade() -> None:
    """Who is there was placed by whoever opened the meeting."""
    brought = sa.Column("brought", sa.Boolean(), nullable=False, server_default=sa.false())
    op.add_column("performer", brought)


def downgrade() -> None:
    """Who was brought stays."""
    op.drop_column("performer", "brought")
