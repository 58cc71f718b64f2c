"""Pictures of live look that are kept for the next training, until their owner says what becomes of
them.

They belong to a session of `services.api.signalling.whep` and are gone with it. Whoever drives a
performer of their own over it switches keeping on and off, sees what was kept, and then has it
stored and learnt from, or dropped.
"""

from __future__ import annotations

import base64

from fastapi import APIRouter, status
from fastapi.concurrency import run_in_threadpool

from renderer.splats.model import SplatModel
from services.api import shapes
from services.api.dependencies import CurrentGateway, Joiner
from services.api.signalling import sdp_http
from services.auth import Principal
from services.container import Services
from services.errors import NothingKept, NotKeepable
from services.gateway import Gateway
from services.jobs.kept_frames import (
    performer_row,
    png,
    require_learnable,
    side_words,
    store_kept,
    thumbnail,
)
from services.live.look.keeping import Keeping
from services.live.room import MeetingPerformer
from services.live.sessions.view_session import ViewSession
from services.problems import PROBLEMS, problems

router = APIRouter(tags=["meetings"], responses=PROBLEMS)
_PATH = "/whep/{meeting_id}/{session_id}/kept-frames"


@router.get(_PATH, summary="See what is kept", responses=problems(409))
async def read_kept(
    meeting_id: str, session_id: str, gateway: CurrentGateway, caller: Joiner
) -> shapes.KeptFrames:
    """The pictures that are kept now, small, and which sides they show."""
    _, _, keeping = _keeping(gateway, meeting_id, session_id, caller)
    return await run_in_threadpool(_shown, keeping)


@router.put(_PATH, summary="Switch keeping on or off", responses=problems(409, 410))
async def switch_keeping(
    meeting_id: str,
    session_id: str,
    body: shapes.KeepFrames,
    gateway: CurrentGateway,
    caller: Joiner,
) -> shapes.KeptFrames:
    """Keep pictures of live look that show sides which the model has not seen, or keep no more.
    What is kept is in memory until it is stored by POST, dropped by DELETE or with the session. The
    person must consent to `learning`, and the clip of their model must be stored still."""
    _, performer, keeping = _keeping(gateway, meeting_id, session_id, caller)
    if body.on:
        splats = _splats_of(performer)
        await run_in_threadpool(_require_learnable, gateway.services, meeting_id, performer)
        keeping.start(splats)
    else:
        keeping.stop()
    return await run_in_threadpool(_shown, keeping)


@router.post(
    _PATH,
    status_code=status.HTTP_202_ACCEPTED,
    summary="Store what is kept and learn from it",
    responses=problems(409, 410),
)
async def learn_from_kept(
    meeting_id: str, session_id: str, gateway: CurrentGateway, caller: Joiner
) -> shapes.Job:
    """Store the pictures as a sequence of the person and train their model further, with its clip.
    The new model takes the old one's place if it shows frames of the clip as well; if not, the job
    fails and says why."""
    session, performer, keeping = _keeping(gateway, meeting_id, session_id, caller)
    taken = keeping.take()
    if taken is None:
        raise NothingKept(
            "there must be kept pictures to learn from; got none; switch live look on and turn to "
            "sides that the clip did not show"
        )
    job = await run_in_threadpool(
        store_kept,
        gateway.services,
        session.account or "",
        performer.performer_id,
        meeting_id,
        *taken,
    )
    return shapes.Job.of(job)


@router.delete(_PATH, status_code=status.HTTP_204_NO_CONTENT, summary="Drop what is kept")
async def drop_kept(
    meeting_id: str, session_id: str, gateway: CurrentGateway, caller: Joiner
) -> None:
    """Keep no more, and forget what was kept."""
    found = gateway.views.kept_of(_session(gateway, meeting_id, session_id, caller))
    if found is not None:
        found[1].drop()


def _session(gateway: Gateway, meeting_id: str, session_id: str, caller: Principal) -> ViewSession:
    """Raises OtherMeeting, NotFound, NotOwner."""
    sdp_http.own_session(gateway.views, session_id, meeting_id, caller)
    session = gateway.views.find(session_id)
    assert session is not None
    # viewers without a seat share one id: none
    caller.require_account(session.account or "")
    return session


def _keeping(
    gateway: Gateway, meeting_id: str, session_id: str, caller: Principal
) -> tuple[ViewSession, MeetingPerformer, Keeping]:
    """Raises as `_session`, and NotKeepable."""
    session = _session(gateway, meeting_id, session_id, caller)
    found = gateway.views.kept_of(session)
    if found is None:
        raise NotKeepable(
            "pictures are kept of somebody of your own who moves by your webcam; got a "
            "connection that drives nobody of yours or has no place for pictures; switch Track "
            "my movements on"
        )
    return session, *found


def _splats_of(performer: MeetingPerformer) -> SplatModel:
    splats = performer.model.splats
    if splats is None:
        raise NotKeepable(
            f"pictures are kept for a model of splats; got {performer.name}, whose model is a "
            f"{performer.model.preset!r}; train one of splats"
        )
    return splats


def _require_learnable(services: Services, meeting_id: str, performer: MeetingPerformer) -> None:
    with services.reading() as unit:
        row = performer_row(unit, meeting_id, performer.performer_id)
        model = unit.models.get(row.model_id)
        require_learnable(unit, row.person, model, services.clock())


def _shown(keeping: Keeping) -> shapes.KeptFrames:
    return shapes.KeptFrames(
        on=keeping.on,
        frames=[
            shapes.KeptFrame(
                picture="data:image/png;base64,"
                + base64.b64encode(png(thumbnail(one))).decode("ascii"),
                sides=[side_words(side) for side in one.sides],
            )
            for one in keeping.frames
        ],
    )
