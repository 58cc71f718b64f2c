"""Meetings: open one, see who stands in it, bring somebody in, join."""

from __future__ import annotations

from fastapi import APIRouter, Response, status
from fastapi.concurrency import run_in_threadpool

from services import meetings, seats
from services.access import model_of, sequence_of
from services.api import meeting_shapes as shapes
from services.api.dependencies import CurrentGateway, Joiner, Provided, Writer
from services.audit import note_of_meeting
from services.auth import Principal
from services.container import Services
from services.jobs.events import meeting_topic
from services.live.ice_servers import ice_servers
from services.problems import PROBLEMS

router = APIRouter(prefix="/v1", tags=["meetings"], responses=PROBLEMS)


@router.post("/meetings", status_code=status.HTTP_201_CREATED, summary="Open a meeting")
def open_meeting(
    body: shapes.NewMeeting, services: Provided, caller: Writer
) -> shapes.OpenedMeeting:
    """A meeting with the given models in it; send its `join_url` to those who should come."""
    with services.unit_of_work() as unit:
        models = [model_of(unit, caller, model_id) for model_id in body.model_ids]
        meeting = meetings.create_meeting(
            services,
            unit,
            caller.account,
            body.name,
            models,
            lobby=body.lobby,
            sealed=body.sealed,
        )
        unit.commit()
        link = meetings.join_url(services, meeting)
        opened = shapes.Meeting.of(meeting, link, caller, services.clock())
    return shapes.OpenedMeeting(**dict(opened), host_token=meetings.host_token(services, meeting))


@router.get("/meetings/{meeting_id}", summary="Read a meeting")
def read_meeting(meeting_id: str, services: Provided, caller: Joiner) -> shapes.Meeting:
    """The performers and their positions. Whoever knows a meeting's id is invited to it, until its
    host renews the invitation."""
    caller.require_meeting(meeting_id)
    with services.reading() as unit:
        meeting = unit.meetings.get(meeting_id)
        seats.require_invited(meeting, caller)
        recording = unit.recordings.under_way(meeting_id) is not None
    link = meetings.join_url(services, meeting)
    told = shapes.Meeting.of(meeting, link, caller, services.clock())
    return told.model_copy(update={"recording": recording})


@router.post("/meetings/{meeting_id}/invitation", summary="Renew a meeting's invitation")
async def renew_invitation(
    meeting_id: str, gateway: CurrentGateway, services: Provided, caller: Joiner
) -> shapes.Invitation:
    """A new link; those of before bring nobody in any more. Only the host may.

    Whoever is in the meeting stays in it; viewers without a seat have to join.
    """
    caller.require_meeting(meeting_id)
    invitation = await run_in_threadpool(_renew_invitation, services, caller, meeting_id)
    gateway.hub.notify(meeting_id)
    await run_in_threadpool(services.events.publish, meeting_topic(meeting_id))
    return invitation


@router.post(
    "/meetings/{meeting_id}/performers",
    status_code=status.HTTP_201_CREATED,
    summary="Add a performer",
)
async def add_performer(
    meeting_id: str,
    body: shapes.NewPerformer,
    gateway: CurrentGateway,
    services: Provided,
    caller: Writer,
) -> shapes.Performer:
    """Place a model in the meeting; the other performers stay where they are.

    Whoever sits in a meeting that another account opened brings one of their own: the next takes
    that one's place. They are shown while their owner is there.
    """
    performer = await run_in_threadpool(_add, services, caller, meeting_id, body)
    await gateway.show_anew(meeting_id)
    return performer


@router.delete(
    "/meetings/{meeting_id}/performers/{performer_id}",
    status_code=status.HTTP_204_NO_CONTENT,
    summary="Remove a performer",
)
async def remove_performer(
    meeting_id: str, performer_id: str, gateway: CurrentGateway, services: Provided, caller: Writer
) -> Response:
    """Take a performer out of the meeting."""
    await run_in_threadpool(_remove, services, caller, meeting_id, performer_id)
    await gateway.show_anew(meeting_id)
    return Response(status_code=204)


@router.post("/meetings/{meeting_id}/join", summary="Join a meeting")
def join_meeting(
    meeting_id: str,
    body: shapes.Visitor,
    gateway: CurrentGateway,
    services: Provided,
    caller: Joiner,
) -> shapes.Seat:
    """A seat, and the token that opens `whep_url` to see and `control_url` to talk.

    Where the host lets people in one by one, there is nothing to see until then: wait on
    `control_url`.
    """
    caller.require_meeting(meeting_id)
    now = services.clock()
    with services.unit_of_work() as unit:
        meeting = unit.meetings.get_for_change(meeting_id)
        seat, token = seats.take_seat(services, unit, meeting, caller, body.display_name)
        home = gateway.homes.settle(unit, meeting)
        unit.commit()
    return shapes.Seat(
        token=token,
        participant_id=seat.id,
        seat=seat.seat,
        role=seat.role,
        admission=seat.admission,
        ice_servers=ice_servers(services.settings.live, seat.id, now),
        gateway_url=home.url,
        whep_url=f"{home.url}/whep/{meeting_id}",
        control_url=f"{home.url}/v1/meetings/{meeting_id}/control",
        ready=gateway.views.ready,
        performers=[shapes.Performer.of(one, caller, now) for one in meeting.shown_at(now)],
        viewpoint=shapes.Viewpoint.of(meetings.default_viewpoint(meeting, caller.account, now)),
    )


@router.get("/meetings/{meeting_id}/home", summary="Find a meeting's home")
def find_home(meeting_id: str, gateway: CurrentGateway, caller: Joiner) -> shapes.MeetingHome:
    """The gateway to connect to, at first and whenever a connection was lost; one that has ended
    is replaced by another."""
    caller.require_meeting(meeting_id)
    with gateway.services.reading() as unit:
        seats.require_not_removed(unit.meetings.get(meeting_id), caller)
    return shapes.MeetingHome(gateway_url=gateway.homes.find(meeting_id).url)


@router.get("/demo", summary="The demo's meeting")
def read_demo(services: Provided) -> shapes.DemoMeeting:
    """The meeting that this server shows to everybody: only under `metanerf demo` is there one."""
    with services.reading() as unit:
        meeting = unit.meetings.with_label(meetings.DEMO)
    shown = meeting is not None and services.settings.security.open_access
    return shapes.DemoMeeting(meeting_id=meeting.id if meeting and shown else None)


def _renew_invitation(services: Services, caller: Principal, meeting_id: str) -> shapes.Invitation:
    with services.unit_of_work() as unit:
        meeting = unit.meetings.get_for_change(meeting_id)
        seats.require_host(meeting, caller)
        meeting.invitation += 1
        note_of_meeting(services, unit, caller.account, "invitation_renewed", meeting_id)
        unit.commit()
    return shapes.Invitation(join_url=meetings.join_url(services, meeting))


def _add(
    services: Services, caller: Principal, meeting_id: str, body: shapes.NewPerformer
) -> shapes.Performer:
    with services.unit_of_work() as unit:
        meeting = unit.meetings.get_for_change(meeting_id)
        seats.require_taking_part(meeting, caller, services.clock())
        model = model_of(unit, caller, body.model_id)
        owner = unit.people.get(model.person_id).account
        if not caller.may_use(meeting.account):  # what the demo lends is nobody's to bring along
            caller.require_account(owner)
        # guests in the demo's meeting come and go as themselves, too
        brought = owner == caller.account != meeting.account
        if body.motion_sequence_id is not None:
            sequence_of(unit, caller, body.motion_sequence_id)
        moved_by = body.motion_sequence_id
        performer = meetings.add_performer(
            services, unit, meeting, model, moved_by, brought=brought
        )
        unit.commit()
        return shapes.Performer.of(performer, caller, services.clock())


def _remove(services: Services, caller: Principal, meeting_id: str, performer_id: str) -> None:
    with services.unit_of_work() as unit:
        meeting = unit.meetings.get_for_change(meeting_id)
        seats.require_not_removed(meeting, caller)
        owners = {one.account for one in meeting.performers if one.id == performer_id}
        if caller.account not in owners | {meeting.account}:
            caller.require_use(meeting.account)
            for owner in owners:  # a guest sends out nobody else's
                caller.require_account(owner)
        meetings.remove_performer(meeting, performer_id)
        unit.commit()
