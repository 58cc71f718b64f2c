"""What a person's model may be used for: read, give, revoke."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from fastapi.concurrency import run_in_threadpool

from db.models import AuditEventRow, PersonRow
from db.repositories import UnitOfWork
from services import likeness
from services.access import person_of
from services.api import shapes
from services.api.dependencies import CurrentGateway, Provided, Reader, Writer
from services.auth import Principal
from services.container import Services
from services.gateway import Gateway
from services.jobs.kept_frames import forget_kept
from services.jobs.queue import drop_orphans
from services.problems import PROBLEMS

router = APIRouter(prefix="/v1/people", tags=["people"], responses=PROBLEMS)


@router.get("/{person_id}/consent", summary="Read a consent")
def read_consent(person_id: str, services: Provided, caller: Reader) -> shapes.Consent:
    """What the person's model may be used for, until when, and whether that holds now."""
    with services.reading() as unit:
        return shapes.Consent.of(person_of(unit, caller, person_id), services.clock())


@router.put("/{person_id}/consent", summary="Give a consent")
async def put_consent(
    person_id: str,
    body: shapes.NewConsent,
    gateway: CurrentGateway,
    services: Provided,
    caller: Writer,
) -> shapes.Consent:
    """Give the consent anew, in place of what it was, revoked or not; it acts at once, in meetings
    that run and on recordings too."""
    given = await run_in_threadpool(_give, services, caller, person_id, body)
    return await _acted_on(gateway, *given)


@router.delete("/{person_id}/consent", summary="Revoke a consent")
async def delete_consent(
    person_id: str, gateway: CurrentGateway, services: Provided, caller: Writer
) -> shapes.Consent:
    """Revoke the consent at once: the model vanishes from meetings that run, its file is handed out
    no more, and recordings show it no longer. Revoking again changes nothing."""
    revoked = await run_in_threadpool(_revoke, services, caller, person_id)
    return await _acted_on(gateway, *revoked)


async def _acted_on(
    gateway: Gateway, consent: shapes.Consent, meeting_ids: list[str]
) -> shapes.Consent:
    for meeting_id in meeting_ids:
        await gateway.show_anew(meeting_id)
    return consent


def _give(
    services: Services, caller: Principal, person_id: str, body: shapes.NewConsent
) -> tuple[shapes.Consent, list[str]]:
    with services.unit_of_work() as unit:
        person = person_of(unit, caller, person_id)
        likeness.give_consent(person, body.purposes, body.until, services.clock())
        return _commit(services, unit, person, caller, "consent.given")


def _revoke(
    services: Services, caller: Principal, person_id: str
) -> tuple[shapes.Consent, list[str]]:
    now = services.clock()
    with services.unit_of_work() as unit:
        person = person_of(unit, caller, person_id)
        if person.consent_revoked_at is not None:
            return shapes.Consent.of(person, now), []
        person.consent_revoked_at = now
        return _commit(services, unit, person, caller, "consent.revoked")


def _commit(
    services: Services, unit: UnitOfWork, person: PersonRow, caller: Principal, action: str
) -> tuple[shapes.Consent, list[str]]:
    """Note the change and make it so; the consent, and the meetings in which it is to be seen."""
    now = services.clock()
    orphans = forget_kept(unit, person, now)
    details: dict[str, Any] = likeness.consent_details(person)
    unit.audit.add(
        AuditEventRow(
            person_id=person.id, at=now, account=caller.account, action=action, details=details
        )
    )
    unit.commit()
    drop_orphans(services, orphans)
    return shapes.Consent.of(person, now), unit.meetings.where_performs(person.id)
