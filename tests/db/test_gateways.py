"""Gateways' leases as rows."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from db.models import GatewayRow
from db.unit_of_work import Database

NOW = datetime(2026, 1, 1, tzinfo=UTC)


def renew(database: Database, gateway_id: str, at: datetime, *, free: int = 1) -> None:
    url = f"https://{gateway_id}.example"
    row = GatewayRow(id=gateway_id, url=url, renewed_at=at, free=free, draining=False)
    with database.unit_of_work() as unit:
        unit.gateways.renew(row)
        unit.commit()


def since(database: Database, moment: datetime) -> list[tuple[str, int]]:
    with database.reading() as unit:
        return [(one.id, one.free) for one in unit.gateways.renewed_since(moment)]


def test_a_lease_is_renewed_and_ends(database: Database):
    renew(database, "one", NOW, free=3)
    renew(database, "two", NOW)
    later = NOW + timedelta(seconds=2)
    renew(database, "two", later, free=7)
    assert since(database, NOW) == [("one", 3), ("two", 7)]
    assert since(database, later) == [("two", 7)]
    with database.unit_of_work() as unit:
        unit.gateways.forget("two")
        unit.commit()
    assert since(database, NOW) == [("one", 3)]


def test_who_died_is_forgotten(database: Database):
    renew(database, "one", NOW)
    renew(database, "two", NOW + timedelta(seconds=1))
    with database.unit_of_work() as unit:
        unit.gateways.forget_silent(NOW + timedelta(seconds=1))
        unit.commit()
    assert since(database, NOW) == [("two", 1)]
