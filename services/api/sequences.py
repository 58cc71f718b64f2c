"""Sequences: how far a clip has come, and training from it."""

from __future__ import annotations

from fastapi import APIRouter, Response, status
from fastapi.concurrency import run_in_threadpool

from db.errors import NotFound
from db.models import AuditEventRow, JobKind, ModelRow, SequenceKind, SequenceRow, SequenceState
from renderer.presets import find_preset
from scene.errors import InvalidInput
from services.access import model_of, sequence_of
from services.api import shapes
from services.api.dependencies import CurrentGateway, Provided, Reader, Writer
from services.auth import Principal
from services.container import Services
from services.errors import KeypointsOnly, NotCaptured
from services.jobs.events import QUEUE
from services.jobs.queue import discard, drop_orphans, enqueue
from services.problems import PROBLEMS, problems
from services.quotas import require_room

router = APIRouter(prefix="/v1/sequences", tags=["sequences"], responses=PROBLEMS)


@router.get("/{sequence_id}", summary="Read a sequence")
def read_sequence(sequence_id: str, services: Provided, caller: Reader) -> shapes.Sequence:
    """State, quality and thumbnail of a clip."""
    with services.reading() as unit:
        sequence = sequence_of(unit, caller, sequence_id)
        return shapes.Sequence.of(sequence, unit.jobs.latest(sequence_id, JobKind.CAPTURE))


@router.get(
    "/{sequence_id}/thumbnail",
    summary="Get a thumbnail",
    response_class=Response,
    responses={200: {"content": {"image/png": {}}}},
)
def read_thumbnail(sequence_id: str, services: Provided, caller: Reader) -> Response:
    """The person without the background, as PNG."""
    with services.reading() as unit:
        sequence = sequence_of(unit, caller, sequence_id)
    if sequence.thumbnail_sha256 is None:
        raise NotFound(f"a thumbnail comes with the capture; got a {sequence.state} sequence; wait")
    picture = b"".join(services.objects.stream(sequence.person_id, sequence.thumbnail_sha256))
    headers = {"Cache-Control": "private, max-age=3600", "ETag": f'"{sequence.thumbnail_sha256}"'}
    return Response(picture, media_type="image/png", headers=headers)


@router.delete(
    "/{sequence_id}",
    status_code=status.HTTP_204_NO_CONTENT,
    summary="Delete a sequence",
    responses=problems(409),
)
async def delete_sequence(
    sequence_id: str, gateway: CurrentGateway, services: Provided, caller: Writer
) -> None:
    """Delete a clip, its frames and its motion. Models trained from it stay until their person is
    erased. Performers who played its motion play their own again. 409 while a job works on it."""
    for meeting_id in await run_in_threadpool(_discard, services, caller, sequence_id):
        await gateway.show_anew(meeting_id)


@router.post("/{sequence_id}/models", status_code=status.HTTP_202_ACCEPTED, summary="Train a model")
def train_model(
    sequence_id: str, body: shapes.NewModel, services: Provided, caller: Writer
) -> shapes.Job:
    """Queue a training job; follow it at `/v1/jobs/{id}/events`. Before the clip is captured it
    waits for that, and in the meantime its `model_id` names a first likeness (splats)."""
    preset = find_preset(body.preset)
    longest = services.settings.jobs.max_budget_s
    if body.budget_s > longest:
        raise InvalidInput(
            f"budget_s must be at most {longest:g}; got {body.budget_s:g}; ask for less time",
        )
    with services.reading() as unit:
        sequence_of(unit, caller, sequence_id)
    require_room(services, caller.account, models=1)
    with services.unit_of_work() as unit:
        sequence = sequence_of(unit, caller, sequence_id)
        if sequence.kind is SequenceKind.KEYPOINTS:
            raise KeypointsOnly(
                "a model must be trained from pictures of the person; got keypoints alone, which "
                "have no colours; they can drive a model (`motion_sequence_id` of a view), or "
                "upload a video",
            )
        capture = unit.jobs.latest(sequence_id, JobKind.CAPTURE)
        if sequence.state is not SequenceState.READY and (capture is None or capture.state.final):
            raise NotCaptured(
                "a sequence must be captured, or on its way to be, to be trained from; got "
                f"{sequence.state}; resume its capture or upload the clip again",
            )
        if body.improves is not None:
            _require_improvable(model_of(unit, caller, body.improves), sequence, preset.name)
        elif sequence.kind is SequenceKind.LIVE:
            raise InvalidInput(
                "improves must name the model that learns from pictures of live look; got none; "
                "name the person's model"
            )
        sequence.model_only = sequence.model_only or body.model_only
        params = body.model_dump() | {"preset": preset.name}
        within = services.tracing.here()
        job = enqueue(unit, JobKind.TRAIN, sequence, params, services.clock(), within)
        unit.commit()
    services.events.publish(QUEUE)
    return shapes.Job.of(job)


def _discard(services: Services, caller: Principal, sequence_id: str) -> list[str]:
    """Ids of the meetings in which somebody moved by it."""
    with services.unit_of_work() as unit:
        sequence = sequence_of(unit, caller, sequence_id)
        meeting_ids = unit.meetings.moved_by(sequence_id)
        orphans = discard(unit, sequence)
        unit.audit.add(
            AuditEventRow(
                person_id=sequence.person_id,
                at=services.clock(),
                account=caller.account,
                action="sequence.deleted",
                details={"kind": str(sequence.kind)},
            )
        )
        unit.commit()
    drop_orphans(services, orphans)
    return meeting_ids


def _require_improvable(model: ModelRow, sequence: SequenceRow, preset: str) -> None:
    if model.person_id != sequence.person_id:
        raise InvalidInput(
            f"improves must be a model of the sequence's person; got one of {model.person_id}; "
            "leave it out",
        )
    if (model.preset, preset) != ("splats", "splats"):
        raise InvalidInput(
            f"improves must be a model of splats and go with the preset splats; got one of "
            f"{model.preset!r} and the preset {preset!r}; leave it out",
        )
