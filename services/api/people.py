"""People: make, list, read, erase."""

from __future__ import annotations

from fastapi import APIRouter, status
from fastapi.concurrency import run_in_threadpool

from db.erase import erase_person
from db.models import AuditEventRow, JobKind, PersonRow, new_id
from services import likeness
from services.access import person_of
from services.api import shapes
from services.api.dependencies import CurrentGateway, Provided, Reader, Writer
from services.auth import GUEST, Principal
from services.container import Services
from services.jobs.events import QUEUE
from services.problems import PROBLEMS
from services.quotas import require_room

router = APIRouter(prefix="/v1/people", tags=["people"], responses=PROBLEMS)


@router.post("", status_code=status.HTTP_201_CREATED, summary="Add a person")
def add_person(body: shapes.NewPerson, services: Provided, caller: Writer) -> shapes.Person:
    """Create a person, to whom clips and models then belong."""
    require_room(services, caller.account, people=1)
    now = services.clock()
    person = PersonRow(
        id=new_id(),
        account=caller.account,
        name=body.name,
        created_at=now,
        height_m=body.height_m,
    )
    likeness.give_consent(person, body.consent.purposes, body.consent.until, now)
    with services.unit_of_work() as unit:
        unit.people.add(person)
        unit.flush()
        unit.audit.add(
            AuditEventRow(
                person_id=person.id,
                at=now,
                account=caller.account,
                action="person.added",
                details={"consent": likeness.consent_details(person)},
            )
        )
        unit.commit()
    return shapes.Person.of(person, now)


@router.get("", summary="List your people")
def list_people(services: Provided, caller: Reader) -> shapes.People:
    """The people whom the demo lends, then those of the token's account, the oldest first."""
    with services.reading() as unit:
        people = unit.people.of_account(caller.account)
        if caller.may_use(GUEST) and caller.account != GUEST:
            people = unit.people.of_account(GUEST) + people
    return shapes.People(
        items=[
            shapes.ListedPerson(
                **dict(shapes.Person.of(person, services.clock())),
                mine=person.account == caller.account,
            )
            for person in people
        ]
    )


@router.get("/{person_id}", summary="Read a person")
def read_person(person_id: str, services: Provided, caller: Reader) -> shapes.PersonInFull:
    """A person with all of their sequences and models."""
    with services.reading() as unit:
        person = person_of(unit, caller, person_id)
        sequences = [
            shapes.Sequence.of(row, unit.jobs.latest(row.id, JobKind.CAPTURE))
            for row in unit.sequences.of_person(person_id)
        ]
        models = [shapes.Model.of(row) for row in unit.models.of_person(person_id)]
    return shapes.PersonInFull(
        **dict(shapes.Person.of(person, services.clock())),
        sequences=sequences,
        models=models,
    )


@router.delete("/{person_id}", summary="Erase a person")
async def delete_person(
    person_id: str, gateway: CurrentGateway, services: Provided, caller: Writer
) -> shapes.Erased:
    """Delete every row and object of a person; `remaining` counts what is left, which is zero."""
    erased, meeting_ids = await run_in_threadpool(_erase, services, caller, person_id)
    for meeting_id in meeting_ids:
        await gateway.show_anew(meeting_id)
    return erased


def _erase(
    services: Services, caller: Principal, person_id: str
) -> tuple[shapes.Erased, list[str]]:
    with services.reading() as unit:
        person_of(unit, caller, person_id)
        meeting_ids = unit.meetings.where_performs(person_id)
    erased = erase_person(
        services.unit_of_work, services.objects, person_id, caller.account, services.clock()
    )
    services.models.forget_person(person_id)
    services.events.publish(QUEUE)  # a job of theirs that runs must stop
    told = shapes.Erased(
        deleted_rows=erased.deleted_rows,
        deleted_objects=erased.deleted_objects,
        remaining=erased.remaining,
    )
    return told, meeting_ids
