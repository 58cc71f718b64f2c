"""Voices in a meeting: each speaker's Opus packets go to every other member as they are.

`POST /v1/meetings/{id}/voice` answers an SDP offer (services.live.signalling.sdp_http) from a seat
whose owner is let in. The offer may have

- audio sections that receive, at most `SLOTS`: slot 0 comes in the first of them, and so on.
  Whoever offers fewer hears fewer. A slot carries one speaker at a time; `speaking` on the control
  channel says who holds which (`slots`, participants' ids) whenever that changes, so that a page
  can set each voice where its speaker stands.
- one audio section that sends (it may be one of those): the microphone. It is heard while the
  roster says that it is on.
- one video section that receives: the screen that somebody shares
  (services.live.signalling.whip), if anybody does.

It is a connection of its own: a picture that stalls is replaced without cutting anybody off.
Nothing is decoded or mixed here, so a speaker costs a packet a listener.

On the page `VoiceLink` (client/src/meeting/voice.ts) keeps `slots: Map<slot, {memberId, stream}>`
and `screen: MediaStream | null`, and tells of each change.
"""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response, status
from fastapi.concurrency import run_in_threadpool

from db.models import MeetingRow
from services import seats
from services.auth import Joiner, Principal
from services.container import Provided, Services
from services.live.sessions.view_sessions import NoRoom
from services.live.sessions.voice_offer import Door
from services.live.sessions.voice_sessions import VoiceSessions
from services.live.signalling import sdp_http
from services.live.signalling.sdp_http import SDP
from services.problems import PROBLEMS, ProblemError

router = APIRouter(prefix="/v1/meetings", tags=["meetings"], responses=PROBLEMS)

_RETRY_AFTER_S = 5


def _sessions(request: Request) -> VoiceSessions:
    return request.app.state.voices


Voices = Annotated[VoiceSessions, Depends(_sessions)]


async def open_call(
    request: Request, services: Services, voices: VoiceSessions, caller: Principal, door: Door,
    meeting_id: str, place: str,
) -> Response:  # fmt: skip
    """Answer the offer of somebody who is let in; its session is found below `place`."""
    caller.require_meeting(meeting_id)
    if caller.participant_id is None:
        raise ProblemError(
            403, "no-seat", "the token must be one that joining gave; got one without a seat; join"
        )
    sdp_offer = await sdp_http.read_offer(request)
    meeting = await run_in_threadpool(_meeting, services, meeting_id)
    seats.require_admitted(meeting, caller)
    try:
        call_id, answer = await voices.open(meeting_id, caller.participant_id, sdp_offer, door)
    except NoRoom as full:
        headers = {"Retry-After": str(_RETRY_AFTER_S)}
        raise ProblemError(503, "server-full", str(full), headers=headers) from full
    # whoever is sent out from now on hears nothing more
    request.app.state.hub.stir(meeting_id)
    location = f"{place}/{call_id}"
    ice_servers = services.settings.ice_servers
    return sdp_http.created(location, call_id, sdp_http.mux_only(answer), ice_servers)


@router.post(
    "/{meeting_id}/voice",
    status_code=status.HTTP_201_CREATED,
    summary="Talk in a meeting",
    response_class=Response,
    responses={201: {"content": {SDP: {}}, "description": "The SDP answer."}},
)
async def talk(
    meeting_id: str, request: Request, services: Provided, voices: Voices, caller: Joiner
) -> Response:
    """One's microphone up, the others' voices down; from a seat whose owner is let in."""
    place = f"/v1/meetings/{meeting_id}/voice"
    return await open_call(request, services, voices, caller, Door.VOICE, meeting_id, place)


@router.patch("/{meeting_id}/voice/{call_id}", summary="Add candidates", status_code=204)
async def trickle(
    meeting_id: str, call_id: str, request: Request, voices: Voices, caller: Joiner
) -> Response:
    """More addresses at which the caller can be reached."""
    call = sdp_http.session_of(voices, call_id, meeting_id, caller)
    return await sdp_http.trickle(request, call, call_id)


@router.delete("/{meeting_id}/voice/{call_id}", summary="Hang up")
async def hang_up(meeting_id: str, call_id: str, voices: Voices, caller: Joiner) -> Response:
    """End the connection."""
    return await sdp_http.end(voices, call_id, meeting_id, caller)


def _meeting(services: Services, meeting_id: str) -> MeetingRow:
    with services.reading() as unit:
        return unit.meetings.get(meeting_id)
