"""Jobs: state, progress as server-sent events, cancel, resume."""

from __future__ import annotations

from collections.abc import AsyncIterator

from fastapi import APIRouter, Response, status
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse

from db.errors import DatabaseAway, NotFound
from services.access import job_of
from services.api import shapes
from services.api.dependencies import CurrentGateway, Provided, Reader, Writer
from services.container import Services
from services.gateway import Gateway
from services.jobs.events import QUEUE, job_topic
from services.jobs.queue import cancel, drop_orphans, resume
from services.problems import PROBLEMS, problems

router = APIRouter(prefix="/v1/jobs", tags=["jobs"], responses=PROBLEMS)

_LOOK_S = 2.0
"""How often the row is read where no event says that it changed."""
_KEEP_ALIVE_S = 15.0
"""Silence after which proxies would close the stream; a comment is sent before."""


@router.get("/{job_id}", summary="Read a job")
def read_job(job_id: str, services: Provided, caller: Reader) -> shapes.Job:
    """State and progress of a job."""
    with services.reading() as unit:
        return shapes.Job.of(job_of(unit, caller, job_id))


@router.delete("/{job_id}", status_code=status.HTTP_202_ACCEPTED, summary="Cancel a job")
def cancel_job(job_id: str, services: Provided, caller: Writer) -> shapes.Job:
    """Cancel a job. A training keeps its checkpoint; a capture keeps nothing."""
    with services.unit_of_work() as unit:
        job = job_of(unit, caller, job_id)
        orphans = cancel(unit, job, services.clock())
        unit.commit()
    drop_orphans(services, orphans)
    services.events.publish(QUEUE)
    services.events.publish(job_topic(job_id))
    return shapes.Job.of(job)


@router.post(
    "/{job_id}/resume",
    status_code=status.HTTP_202_ACCEPTED,
    summary="Resume a job",
    responses=problems(409, 410),
)
def resume_job(job_id: str, services: Provided, caller: Writer) -> shapes.Job:
    """Queue a cancelled or failed job again. A training continues from its checkpoint."""
    with services.unit_of_work() as unit:
        job = job_of(unit, caller, job_id)
        resume(unit, job)
        unit.commit()
    services.events.publish(QUEUE)
    services.events.publish(job_topic(job_id))
    return shapes.Job.of(job)


@router.get(
    "/{job_id}/preview",
    summary="The latest picture of the model",
    response_class=Response,
    responses={200: {"content": {"image/png": {}}}},
)
def read_preview(job_id: str, services: Provided, caller: Reader) -> Response:
    """A PNG, available as soon as the job has `has_preview`."""
    with services.reading() as unit:
        job_of(unit, caller, job_id)
        picture = unit.jobs.preview(job_id)
    if picture is None:
        raise NotFound(f"a preview comes with the first progress of a training; got {job_id!r}")
    return Response(picture, media_type="image/png", headers={"Cache-Control": "no-store"})


@router.get(
    "/{job_id}/events",
    summary="Follow a job",
    response_class=StreamingResponse,
    responses={
        200: {
            "content": {"text/event-stream": {}},
            "description": "The job at each `progress`; `end` when it is over.",
        }
    },
)
async def follow_job(
    job_id: str, gateway: CurrentGateway, services: Provided, caller: Reader
) -> StreamingResponse:
    """Server-sent events: `progress` with the job, and finally one `end`."""
    await run_in_threadpool(_read, services, caller, job_id)
    gateway.followers.require_room(caller.account)
    return StreamingResponse(
        _followed(gateway, caller.account, job_id),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


async def _followed(gateway: Gateway, account: str, job_id: str) -> AsyncIterator[str]:
    with gateway.followers.held(account):
        async for event in _events(gateway.services, job_id):
            yield event


async def _events(services: Services, job_id: str) -> AsyncIterator[str]:
    told, quiet_s = "", 0.0
    async with services.events.listen(job_topic(job_id)) as listener:
        while True:
            try:
                job, mark = await run_in_threadpool(_look, services, job_id)
            except NotFound:  # erased with its person
                yield 'event: end\ndata: {"state": "erased"}\n\n'
                return
            except DatabaseAway:
                yield ": the database is away\n\n"
                await listener.wait(_LOOK_S)
                continue
            data = job.model_dump_json()
            if data + mark != told:
                told, quiet_s = data + mark, 0.0
                yield f"event: progress\ndata: {data}\n\n"
            if job.state.final:
                yield f"event: end\ndata: {data}\n\n"
                return
            await listener.wait(_LOOK_S)
            quiet_s += _LOOK_S
            if quiet_s >= _KEEP_ALIVE_S:
                quiet_s = 0.0
                yield ": still here\n\n"


def _look(services: Services, job_id: str) -> tuple[shapes.Job, str]:
    """The job, and a mark that changes with its preview."""
    with services.reading() as unit:
        job = unit.jobs.get(job_id)
    return shapes.Job.of(job), f"#{job.preview_version}"


def _read(services: Services, caller: Reader, job_id: str) -> None:
    with services.reading() as unit:
        job_of(unit, caller, job_id)
