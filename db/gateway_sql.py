"""Gateways and their leases, by SQLAlchemy; see `db.meeting_repositories.Gateways`."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import delete, select

from db.models import GatewayRow
from db.sql_repository import SqlRepository


class SqlGateways(SqlRepository):
    """Gateways that serve meetings."""

    def renew(self, gateway: GatewayRow) -> None:
        """See `Gateways.renew`."""
        self._session.merge(gateway)

    def renewed_since(self, moment: datetime) -> list[GatewayRow]:
        """See `Gateways.renewed_since`."""
        query = select(GatewayRow).where(GatewayRow.renewed_at >= moment).order_by(GatewayRow.id)
        return list(self._session.scalars(query))

    def forget(self, gateway_id: str) -> None:
        """See `Gateways.forget`."""
        self._session.execute(delete(GatewayRow).where(GatewayRow.id == gateway_id))

    def forget_silent(self, since: datetime) -> None:
        """See `Gateways.forget_silent`."""
        self._session.execute(delete(GatewayRow).where(GatewayRow.renewed_at < since))
