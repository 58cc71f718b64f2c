"""WHEP (draft-ietf-wish-whep): a viewer posts an SDP offer, the answer brings their own view.

`POST /whep/{meeting}` opens a session and `DELETE` on its location ends it, as
services.live.signalling.sdp_http has it. The view follows the data channel `view` that the viewer
opens; who opens `pose` as well may draw the room from poses (services.live.packets).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Annotated

from fastapi import APIRouter, Depends, FastAPI, Request, Response, status
from fastapi.concurrency import run_in_threadpool
from prometheus_client import Gauge

from db.errors import DatabaseError
from scene.environment import Environment
from services import seats
from services.auth import Joiner, Principal
from services.container import Provided, Services
from services.environments import environment_in
from services.live.room import CastMember
from services.live.sessions.view_sessions import NoRoom, ViewSessions
from services.live.signalling import sdp_http
from services.live.signalling.sdp_http import SDP
from services.meetings import performed_motion
from services.problems import PROBLEMS, ProblemError

log = logging.getLogger(__name__)

router = APIRouter(tags=["meetings"], responses=PROBLEMS)

_RETRY_AFTER_S = 5
VIEWERS = Gauge("metanerf_viewers", "Viewers served live now.")
RENDER_MS = Gauge("metanerf_render_milliseconds", "Median of the latest renders, ms.")


def install(app: FastAPI, services: Services) -> ViewSessions:
    """Make the view sessions of `app`, and have them told when a cast changes."""

    async def load_cast(meeting_id: str) -> tuple[CastMember, ...]:
        return await run_in_threadpool(cast_of, services, meeting_id)

    async def load_environment(meeting_id: str) -> Environment:
        return await run_in_threadpool(environment_of, services, meeting_id)

    sessions = ViewSessions(
        load_cast,
        load_environment,
        _StoredSeats(services),
        time.monotonic,
        ice_servers=services.settings.ice_servers,
        max_viewers=services.settings.max_viewers,
        stamped=services.settings.stamp_pictures,
    )
    app.state.views = sessions
    app.state.cast_listeners.append(sessions.refresh)
    app.include_router(router)
    VIEWERS.set_function(lambda: len(sessions))
    RENDER_MS.set_function(lambda: _median(sessions.render_milliseconds()))
    return sessions


class _StoredSeats:
    """Seats as rows. A database that is away ends no view: what can't be noted lapses."""

    def __init__(self, services: Services) -> None:
        self._services = services

    async def keep(self, participant_ids: set[str]) -> None:
        await self._tell(seats.keep_seats, participant_ids)

    async def give_back(self, participant_ids: set[str]) -> None:
        await self._tell(seats.give_back, participant_ids)

    async def _tell(
        self, change: Callable[[Services, set[str]], object], participant_ids: set[str]
    ) -> None:
        try:
            await run_in_threadpool(change, self._services, participant_ids)
        except DatabaseError as error:
            log.warning("seats could not be noted: %s", error)


def _sessions(request: Request) -> ViewSessions:
    return request.app.state.views


Views = Annotated[ViewSessions, Depends(_sessions)]


@router.post(
    "/whep/{meeting_id}",
    status_code=status.HTTP_201_CREATED,
    summary="Look into a meeting",
    response_class=Response,
    responses={201: {"content": {SDP: {}}, "description": "The SDP answer."}},
)
async def look(
    meeting_id: str, request: Request, services: Provided, views: Views, caller: Joiner
) -> Response:
    """One rendered view; the viewer chooses where to stand by the data channel `view`."""
    caller.require_meeting(meeting_id)
    sdp_offer = await sdp_http.read_offer(request)
    await run_in_threadpool(_require_place, services, meeting_id, caller)
    try:
        session_id, sdp_answer = await views.open(
            meeting_id, sdp_offer, caller.participant_id, caller.account
        )
    except NoRoom as full:
        headers = {"Retry-After": str(_RETRY_AFTER_S)}
        raise ProblemError(503, "server-full", str(full), headers=headers) from full
    # whoever is sent out from now on sees nothing more
    request.app.state.hub.stir(meeting_id)
    location, ice_servers = f"/whep/{meeting_id}/{session_id}", services.settings.ice_servers
    return sdp_http.created(location, session_id, sdp_http.mux_only(sdp_answer), ice_servers)


@router.options("/whep/{meeting_id}", summary="What a viewer may post", status_code=204)
async def tell_door(meeting_id: str) -> Response:
    """The methods and types that this door takes."""
    return sdp_http.options("POST, OPTIONS")


@router.patch("/whep/{meeting_id}/{session_id}", summary="Add candidates", status_code=204)
async def trickle(
    meeting_id: str, session_id: str, request: Request, views: Views, caller: Joiner
) -> Response:
    """More addresses at which the viewer can be reached."""
    session = sdp_http.session_of(views, session_id, meeting_id, caller)
    return await sdp_http.trickle(request, session, session_id)


@router.delete("/whep/{meeting_id}/{session_id}", summary="Look away")
async def look_away(meeting_id: str, session_id: str, views: Views, caller: Joiner) -> Response:
    """End the session."""
    return await sdp_http.end(views, session_id, meeting_id, caller)


def _require_place(services: Services, meeting_id: str, caller: Principal) -> None:
    with services.reading() as unit:
        meeting = unit.meetings.get(meeting_id)
    seats.require_admitted(meeting, caller)
    if caller.participant_id is not None:
        seats.keep_seats(services, {caller.participant_id})


def cast_of(services: Services, meeting_id: str) -> tuple[CastMember, ...]:
    """The performers of a meeting, ready to be shown. Raises NotFound."""
    with services.reading() as unit:
        performers = list(unit.meetings.get(meeting_id).performers)
        rows = [unit.models.get(performer.model_id) for performer in performers]
        motions = [performed_motion(services, unit, performer) for performer in performers]
        accounts = [unit.people.get(performer.person_id).account for performer in performers]
    return tuple(
        CastMember(
            performer.id,
            performer.name,
            services.models.load_row(row),
            motion,
            (performer.x_m, performer.y_m, performer.z_m),
            performer.yaw_rad,
            account,
        )
        for performer, row, motion, account in zip(performers, rows, motions, accounts, strict=True)
    )


def environment_of(services: Services, meeting_id: str) -> Environment:
    """The place that a meeting is held in. Raises NotFound."""
    with services.reading() as unit:
        return environment_in(unit, meeting_id)


def _median(values: list[float]) -> float:
    ordered = sorted(values)
    return ordered[len(ordered) // 2] if ordered else 0.0
