"""WHIP (RFC 9725): a client other than our page sends a participant's voice, or their screen.

`POST /whip/{meeting}` with a seat's token and an SDP offer of at most one audio (Opus) and one
video (VP8), both sendonly; services.api.signalling.sdp_http describes the answers. While the
microphone of the seat's owner is on (control channel), their voice is taken from here and not from
their page. The video is shown to everybody as a shared screen; it is accepted only from the
presenter that the control channel names, and ends when somebody else becomes presenter.
"""

from __future__ import annotations

from fastapi import APIRouter, Request, Response, status

from services.api.dependencies import CurrentGateway, Joiner
from services.api.signalling import sdp_http
from services.api.signalling.voice import create_voice_session
from services.live.sessions.voice_offer import Endpoint
from services.problems import PROBLEMS

router = APIRouter(tags=["meetings"], responses=PROBLEMS)


@router.post(
    "/whip/{meeting_id}",
    status_code=status.HTTP_201_CREATED,
    summary="Send a voice or a screen",
    response_class=Response,
    responses=sdp_http.CREATED,
)
async def create_session(
    meeting_id: str, request: Request, gateway: CurrentGateway, caller: Joiner
) -> Response:
    """A microphone, or a screen, of a participant who has a seat and is admitted."""
    path = f"/whip/{meeting_id}"
    return await create_voice_session(request, gateway, caller, Endpoint.WHIP, meeting_id, path)


@router.options("/whip/{meeting_id}", summary="What may be posted", status_code=204)
async def options(meeting_id: str) -> Response:
    """The methods and types of this endpoint."""
    return sdp_http.options("POST, OPTIONS")


@router.patch("/whip/{meeting_id}/{session_id}", summary="Add candidates", status_code=204)
async def add_candidates(
    meeting_id: str, session_id: str, request: Request, gateway: CurrentGateway, caller: Joiner
) -> Response:
    """Trickle ICE: more addresses at which the client can be reached."""
    session = sdp_http.own_session(gateway.voices, session_id, meeting_id, caller)
    return await sdp_http.add_candidates(request, session, session_id)


@router.delete("/whip/{meeting_id}/{session_id}", summary="End the session")
async def end_session(
    meeting_id: str, session_id: str, gateway: CurrentGateway, caller: Joiner
) -> Response:
    """End the connection."""
    return await sdp_http.end_session(gateway.voices, session_id, meeting_id, caller)
