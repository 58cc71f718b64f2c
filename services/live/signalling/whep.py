"""WHEP (draft-ietf-wish-whep): a viewer posts an SDP offer, the answer brings their own view.

`POST /whep/{meeting}` creates a session and `DELETE` of the session resource ends it, as described
in services.live.signalling.sdp_http. The view follows the data channel `view` that the viewer
opens; one who opens `pose` as well may draw the room from poses (services.live.packets).
"""

from __future__ import annotations

import time
from typing import Annotated

from fastapi import APIRouter, Depends, FastAPI, Request, Response, status
from fastapi.concurrency import run_in_threadpool
from prometheus_client import Gauge

from services import seats
from services.auth import Joiner, Principal
from services.container import Provided, Services
from services.live.sessions.stored_meetings import StoredMeetings
from services.live.sessions.view_sessions import ViewSessions
from services.live.signalling import sdp_http
from services.live.signalling.sdp_http import SDP
from services.live.streaming.latency_code import LatencyCode
from services.problems import PROBLEMS, problem_of

router = APIRouter(tags=["meetings"], responses=PROBLEMS)

VIEWERS = Gauge("metanerf_viewers", "Viewers served live now.")
RENDER_MS = Gauge("metanerf_render_milliseconds", "Median of the latest renders, ms.")


def install(app: FastAPI, services: Services) -> ViewSessions:
    """Create the view sessions of `app` and mount their routes."""
    settings = services.settings
    sessions = ViewSessions(
        StoredMeetings(services),
        time.monotonic,
        ice_servers=settings.ice_servers,
        max_viewers=settings.max_viewers,
        describe_error=lambda error: problem_of(error).model_dump_json(),
        instrumentation=LatencyCode() if settings.stamp_pictures else None,
    )
    app.state.views = sessions
    app.state.cast_listeners.append(sessions.refresh)
    app.include_router(router)
    VIEWERS.set_function(lambda: len(sessions))
    RENDER_MS.set_function(lambda: _median(sessions.render_milliseconds()))
    return sessions


def _sessions(request: Request) -> ViewSessions:
    return request.app.state.views


Views = Annotated[ViewSessions, Depends(_sessions)]


@router.post(
    "/whep/{meeting_id}",
    status_code=status.HTTP_201_CREATED,
    summary="Watch a meeting",
    response_class=Response,
    responses={201: {"content": {SDP: {}}, "description": "The SDP answer."}},
)
async def create_session(
    meeting_id: str, request: Request, services: Provided, views: Views, caller: Joiner
) -> Response:
    """One rendered view; the viewer sends their viewpoint over the data channel `view`."""
    caller.require_meeting(meeting_id)
    sdp_offer = await sdp_http.read_offer(request)
    await run_in_threadpool(_require_seat, services, meeting_id, caller)
    session_id, sdp_answer = await views.open(
        meeting_id, sdp_offer, caller.participant_id, caller.account
    )
    # from now on the hub ends the session of a viewer who is removed
    request.app.state.hub.notify(meeting_id)
    location, ice_servers = f"/whep/{meeting_id}/{session_id}", services.settings.ice_servers
    return sdp_http.created(
        location, session_id, sdp_http.add_rtcp_mux_only(sdp_answer), ice_servers
    )


@router.options("/whep/{meeting_id}", summary="What a viewer may post", status_code=204)
async def options(meeting_id: str) -> Response:
    """The methods and types of this endpoint."""
    return sdp_http.options("POST, OPTIONS")


@router.patch("/whep/{meeting_id}/{session_id}", summary="Add candidates", status_code=204)
async def add_candidates(
    meeting_id: str, session_id: str, request: Request, views: Views, caller: Joiner
) -> Response:
    """Trickle ICE: more addresses at which the viewer can be reached."""
    session = sdp_http.own_session(views, session_id, meeting_id, caller)
    return await sdp_http.add_candidates(request, session, session_id)


@router.delete("/whep/{meeting_id}/{session_id}", summary="End the session")
async def end_session(meeting_id: str, session_id: str, views: Views, caller: Joiner) -> Response:
    """End the session."""
    return await sdp_http.end_session(views, session_id, meeting_id, caller)


def _require_seat(services: Services, meeting_id: str, caller: Principal) -> None:
    with services.reading() as unit:
        meeting = unit.meetings.get(meeting_id)
    seats.require_admitted(meeting, caller)
    if caller.participant_id is not None:
        seats.keep_seats(services, {caller.participant_id})


def _median(values: list[float]) -> float:
    ordered = sorted(values)
    return ordered[len(ordered) // 2] if ordered else 0.0
