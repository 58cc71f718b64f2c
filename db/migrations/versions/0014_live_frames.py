"""Which clip pictures of live look are trained on with.

Revision: 0014, after 0013.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # not in a batch: SQLite would make the table anew, and its dropping takes what hangs on it
    op.add_column("sequence", sa.Column("clip_id", sa.String(32)))


def downgrade() -> None:
    op.drop_column("sequence", "clip_id")
