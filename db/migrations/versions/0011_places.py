"""A performer's position follows from the number of their place.

What is kept beside it is which way they were captured, and how high their eyes are. Before,
everybody stood on a circle round the origin and faced it.

Revision: 0011, after 0010.
"""

from __future__ import annotations

import math

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

_EYE_HEIGHT_M = 1.6
"""Of those who came before; measured anew with their next model."""
_POSITION = ("x_m", "y_m", "z_m", "yaw_rad")


def upgrade() -> None:
    with op.batch_alter_table("performer") as table:
        table.add_column(_column("front_yaw_rad", 0.0))
        table.add_column(_column("eye_height_m", _EYE_HEIGHT_M))
    performer = sa.table("performer", *map(sa.column, ("id", "front_yaw_rad", *_POSITION)))
    connection = op.get_bind()
    for row in connection.execute(sa.select(performer)).all():
        facing_rad = math.atan2(-row.x_m, -row.z_m) if math.hypot(row.x_m, row.z_m) > 0.5 else 0.0
        connection.execute(
            performer.update()
            .where(performer.c.id == row.id)
            .values(front_yaw_rad=row.yaw_rad - facing_rad)
        )
    with op.batch_alter_table("performer") as table:
        for name in _POSITION:
            table.drop_column(name)


def downgrade() -> None:
    with op.batch_alter_table("performer") as table:
        for name in _POSITION:
            table.add_column(_column(name, 0.0))
    op.execute("UPDATE performer SET yaw_rad = front_yaw_rad")
    with op.batch_alter_table("performer") as table:
        table.drop_column("front_yaw_rad")
        table.drop_column("eye_height_m")


def _column(name: str, default: float) -> sa.Column[float]:
    return sa.Column(name, sa.Double(), nullable=False, server_default=sa.text(str(default)))
