"""The row of a person, to whom everything else belongs."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import String
from sqlalchemy.orm import Mapped, mapped_column

from db.base import Base, Id, new_id


class PersonRow(Base):
    """Somebody who is, or will be, met."""

    __tablename__ = "person"

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    account: Mapped[str] = mapped_column(String(120), index=True)
    """Whose person this is: the subject of the token that made it."""
    name: Mapped[str] = mapped_column(String(120))
    created_at: Mapped[datetime]
    height_m: Mapped[float | None]
    """Barefoot, as they told it; None is guessed from each clip."""
