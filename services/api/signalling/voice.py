"""Voices in a meeting: each speaker's Opus packets are forwarded to every other participant.

`POST /v1/meetings/{id}/voice` answers an SDP offer (services.api.signalling.sdp_http) from a seat
whose owner is admitted. The offer may have

- audio sections that receive, at most `SLOTS`: slot 0 comes in the first of them, and so on. A page
  that offers fewer hears fewer. A slot carries one speaker at a time; `speaking` on the control
  channel says who holds which (`slots`, participants' ids) whenever that changes, so that a page
  can place each voice where its speaker stands.
- one audio section that sends (it may be one of those): the microphone. It is heard while the
  roster says that it is on.
- one video section that receives: the screen that somebody shares (services.api.signalling.whip),
  if anybody does.

It is a connection of its own: a picture that stalls is replaced without interrupting any voice.
Nothing is decoded or mixed here, so a speaker costs a packet per listener.
"""

from __future__ import annotations

from fastapi import APIRouter, Request, Response, status
from fastapi.concurrency import run_in_threadpool

from db.models import MeetingRow
from services import seats
from services.api.dependencies import CurrentGateway, Joiner
from services.api.signalling import sdp_http
from services.auth import Principal
from services.container import Services
from services.errors import NoSeat
from services.gateway import Gateway
from services.live.sessions.voice_offer import Endpoint
from services.problems import PROBLEMS

router = APIRouter(prefix="/v1/meetings", tags=["meetings"], responses=PROBLEMS)


async def create_voice_session(
    request: Request,
    gateway: Gateway,
    caller: Principal,
    endpoint: Endpoint,
    meeting_id: str,
    path: str,
) -> Response:
    """Answer the offer of an admitted participant; the session resource lies below `path`."""
    caller.require_meeting(meeting_id)
    if caller.participant_id is None:
        raise NoSeat("the token must be one that joining gave; got one without a seat; join")
    sdp_offer = await sdp_http.read_offer(request)
    meeting = await run_in_threadpool(_meeting, gateway.services, meeting_id)
    seats.require_admitted(meeting, caller)
    await run_in_threadpool(gateway.homes.require_here, meeting_id, path)
    session_id, answer = await gateway.voices.open(
        meeting_id, caller.participant_id, sdp_offer, endpoint
    )
    # from now on the hub closes the connection of a participant who is removed
    gateway.hub.notify(meeting_id)
    location = f"{path}/{session_id}"
    return sdp_http.created(gateway.services, caller, location, session_id, answer)


@router.post(
    "/{meeting_id}/voice",
    status_code=status.HTTP_201_CREATED,
    summary="Talk in a meeting",
    response_class=Response,
    responses=sdp_http.CREATED,
)
async def create_session(
    meeting_id: str, request: Request, gateway: CurrentGateway, caller: Joiner
) -> Response:
    """The participant's microphone up, the others' voices down."""
    path = f"/v1/meetings/{meeting_id}/voice"
    return await create_voice_session(request, gateway, caller, Endpoint.VOICE, meeting_id, path)


@router.patch("/{meeting_id}/voice/{session_id}", summary="Add candidates", status_code=204)
async def add_candidates(
    meeting_id: str, session_id: str, request: Request, gateway: CurrentGateway, caller: Joiner
) -> Response:
    """Trickle ICE: more addresses at which the caller can be reached."""
    session = sdp_http.own_session(gateway.voices, session_id, meeting_id, caller)
    return await sdp_http.add_candidates(request, session, session_id)


@router.delete("/{meeting_id}/voice/{session_id}", summary="End the session")
async def end_session(
    meeting_id: str, session_id: str, gateway: CurrentGateway, caller: Joiner
) -> Response:
    """End the connection."""
    return await sdp_http.end_session(gateway.voices, session_id, meeting_id, caller)


def _meeting(services: Services, meeting_id: str) -> MeetingRow:
    with services.reading() as unit:
        return unit.meetings.get(meeting_id)
