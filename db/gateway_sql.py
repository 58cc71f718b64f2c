"""Gateways and their leases, by SQLAlchemy; see `db.meeting_repositories.Gateways`."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import delete, select, update

from db.models import GatewayRow
from db.sql_repository import SqlRepository


class SqlGateways(SqlRepository):
    """Gateways that serve meetings."""

    def renew(self, gateway: GatewayRow) -> None:
        """See `Gateways.renew`."""
        self._session.merge(gateway)

    def promise(self, gateway_id: str) -> None:
        """See `Gateways.promise`."""
        has_room = (GatewayRow.id == gateway_id) & (GatewayRow.free > 0)
        self._session.execute(update(GatewayRow).where(has_room).values(free=GatewayRow.free - 1))

    def free_places(self, gateway_id: str) -> int | None:
        """See `Gateways.free_places`."""
        return self._session.scalar(select(GatewayRow.free).where(GatewayRow.id == gateway_id))

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
