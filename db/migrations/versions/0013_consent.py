"""What a person's likeness may be used for, and until when; and whom a video shows.

Everybody from before has consented to what was done with everybody: being shown in meetings and
recorded where they agreed to it; and the demo's people to being driven by every guest.

Revision: 0013, after 0012.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None

_USUAL = '["meetings", "recordings"]'
_LEND_THE_DEMOS_PEOPLE = """UPDATE person
SET consent_purposes = '["meetings", "recordings", "driving"]' WHERE account = 'guest'"""


def upgrade() -> None:
    # not in a batch: SQLite would make the table anew, and its dropping takes what hangs on it
    op.add_column(
        "person", sa.Column("consent_purposes", sa.JSON(), nullable=False, server_default=_USUAL)
    )
    for name in ("consent_until", "consent_revoked_at"):
        op.add_column("person", sa.Column(name, sa.DateTime(timezone=True)))
    # of a video from before it is not known: it counts as showing whoever was in its recording
    op.add_column("recording_export", sa.Column("shows", sa.JSON()))
    op.execute(_LEND_THE_DEMOS_PEOPLE)


def downgrade() -> None:
    op.drop_column("recording_export", "shows")
    for name in ("consent_revoked_at", "consent_until", "consent_purposes"):
        op.drop_column("person", name)
