"""Jobs that name the trace in which they were asked for.

Revision: 0019, after 0018.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0019"
down_revision = "0018"


def upgrade() -> None:
    """None of before does."""
    op.add_column("job", sa.Column("traceparent", sa.String(55)))


def downgrade() -> None:
    """Traces end with the request."""
    op.drop_column("job", "traceparent")
