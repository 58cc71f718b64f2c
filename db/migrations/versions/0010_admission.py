"""What was called a participant's standing is their admission.

Revision: 0010, after 0009.
"""

from __future__ import annotations

from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # plain SQL, for both databases rename in place, where Alembic's batch mode copies the table
    op.execute("ALTER TABLE participant RENAME COLUMN standing TO admission")


def downgrade() -> None:
    op.execute("ALTER TABLE participant RENAME COLUMN admission TO standing")
