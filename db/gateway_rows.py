"""The table of gateways that serve meetings, each as long as it renews its lease."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import String
from sqlalchemy.orm import Mapped, mapped_column

from db.base import Base, Id


class GatewayRow(Base):
    """A gateway process that browsers reach at an address of its own."""

    __tablename__ = "gateway"

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    """Of the process: the next at the same address has another."""
    url: Mapped[str] = mapped_column(String(255))
    """Its address, scheme and host, without a slash at the end."""
    renewed_at: Mapped[datetime]
    """When it last gave a sign of life."""
    free: Mapped[int]
    """How many more viewers it has room for."""
    draining: Mapped[bool]
    """It is about to end: no meeting lives there any more."""
