"""WHEP (draft-ietf-wish-whep): a viewer posts an SDP offer, the answer brings their own view.

`POST /whep/{meeting}` creates a session and `DELETE` of the session resource ends it, as described
in services.api.signalling.sdp_http. The view follows the data channel `view` that the viewer
opens; one who opens `pose` as well may draw the room from poses (services.live.packets).
"""

from __future__ import annotations

from fastapi import APIRouter, Request, Response, status
from fastapi.concurrency import run_in_threadpool

from services import seats
from services.api.dependencies import CurrentGateway, Joiner, network_of_caller
from services.api.signalling import sdp_http
from services.auth import GUEST, INVITED, Principal, is_guest
from services.container import Services
from services.problems import PROBLEMS

router = APIRouter(tags=["meetings"], responses=PROBLEMS)


@router.post(
    "/whep/{meeting_id}",
    status_code=status.HTTP_201_CREATED,
    summary="Watch a meeting",
    response_class=Response,
    responses=sdp_http.CREATED,
)
async def create_session(
    meeting_id: str, request: Request, gateway: CurrentGateway, caller: Joiner
) -> Response:
    """One rendered view; the viewer sends their viewpoint over the data channel `view`."""
    caller.require_meeting(meeting_id)
    sdp_offer = await sdp_http.read_offer(request)
    async with gateway.views.arriving(caller.participant_id):
        await run_in_threadpool(_require_seat, gateway.services, meeting_id, caller)
        await run_in_threadpool(gateway.homes.require_here, meeting_id, request.url.path)
        room_is_new = not gateway.views.is_watched(meeting_id)
        session_id, sdp_answer = await gateway.views.open(
            meeting_id,
            sdp_offer,
            caller.participant_id,
            caller.account,
            onlooker=_onlooker(request, caller),
        )
    # from now on the hub ends the session of a viewer who is removed
    gateway.hub.notify(meeting_id, room_is_new=room_is_new)
    location = f"/whep/{meeting_id}/{session_id}"
    return sdp_http.created(gateway.services, caller, location, session_id, sdp_answer)


@router.options("/whep/{meeting_id}", summary="What a viewer may post", status_code=204)
async def options(meeting_id: str) -> Response:
    """The methods and types of this endpoint."""
    return sdp_http.options("POST, OPTIONS")


@router.patch("/whep/{meeting_id}/{session_id}", summary="Add candidates", status_code=204)
async def add_candidates(
    meeting_id: str, session_id: str, request: Request, gateway: CurrentGateway, caller: Joiner
) -> Response:
    """Trickle ICE: more addresses at which the viewer can be reached."""
    session = sdp_http.own_session(gateway.views, session_id, meeting_id, caller)
    return await sdp_http.add_candidates(request, session, session_id)


@router.delete("/whep/{meeting_id}/{session_id}", summary="End the session")
async def end_session(
    meeting_id: str, session_id: str, gateway: CurrentGateway, caller: Joiner
) -> Response:
    """End the session."""
    return await sdp_http.end_session(gateway.views, session_id, meeting_id, caller)


def _onlooker(request: Request, caller: Principal) -> str | None:
    """What tells one without a seat from others: their account, or their address where anybody gets
    another account, or many have one."""
    if caller.participant_id is not None:
        return None
    anybodys = caller.account in {GUEST, INVITED} or is_guest(caller.account)
    return network_of_caller(request) if anybodys else caller.account


def _require_seat(services: Services, meeting_id: str, caller: Principal) -> None:
    with services.reading() as unit:
        meeting = unit.meetings.get(meeting_id)
    seats.require_admitted(meeting, caller)
    if caller.participant_id is not None:
        seats.take_up(services, caller.participant_id)
