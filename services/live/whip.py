"""WHIP (RFC 9725): a client that is no page of ours sends a member's voice, or their screen.

`POST /whip/{meeting}` with a seat's token and an SDP offer of at most one audio (Opus) and one
video (VP8), both sendonly; see services.live.signalling for what comes back. The voice is heard as
that of the seat's owner while their microphone is on by the control channel, in place of the one
that their page sends. The video is shown to all as a shared screen, and taken only from whom the
control channel lets present; it ends when somebody else may.
"""

from __future__ import annotations

from fastapi import APIRouter, Request, Response, status

from services.auth import Joiner
from services.container import Provided
from services.live import signalling
from services.live.call_offer import Door
from services.live.signalling import SDP
from services.live.voices import Voices, open_call
from services.problems import PROBLEMS

router = APIRouter(tags=["meetings"], responses=PROBLEMS)


@router.post(
    "/whip/{meeting_id}",
    status_code=status.HTTP_201_CREATED,
    summary="Send a voice or a screen",
    response_class=Response,
    responses={201: {"content": {SDP: {}}, "description": "The SDP answer."}},
)
async def send(
    meeting_id: str, request: Request, services: Provided, voices: Voices, caller: Joiner
) -> Response:
    """A microphone, or a screen, of somebody who sits in the meeting and is let in."""
    place = f"/whip/{meeting_id}"
    return await open_call(request, services, voices, caller, Door.WHIP, meeting_id, place)


@router.options("/whip/{meeting_id}", summary="What may be posted", status_code=204)
async def tell_door(meeting_id: str) -> Response:
    """The methods and types that this door takes."""
    return signalling.options("POST, OPTIONS")


@router.patch("/whip/{meeting_id}/{call_id}", summary="Add candidates", status_code=204)
async def trickle(
    meeting_id: str, call_id: str, request: Request, voices: Voices, caller: Joiner
) -> Response:
    """More addresses at which the client can be reached."""
    call = signalling.session_of(voices, call_id, meeting_id, caller)
    return await signalling.trickle(request, call, call_id)


@router.delete("/whip/{meeting_id}/{call_id}", summary="Send no longer")
async def stop(meeting_id: str, call_id: str, voices: Voices, caller: Joiner) -> Response:
    """End the connection."""
    return await signalling.end(voices, call_id, meeting_id, caller)
