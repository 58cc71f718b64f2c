"""Sequences: how far a clip has come, and training from it."""

from __future__ import annotations

from fastapi import APIRouter, Response, status

from db.errors import NotFound
from db.models import JobKind, SequenceKind, SequenceState
from renderer.presets import find_preset
from services.access import sequence_of
from services.api import shapes
from services.auth import Reader, Writer
from services.container import Provided
from services.jobs.events import QUEUE
from services.jobs.queue import enqueue
from services.problems import PROBLEMS, ProblemError

router = APIRouter(prefix="/v1/sequences", tags=["sequences"], responses=PROBLEMS)


@router.get("/{sequence_id}", summary="Read a sequence")
def read_sequence(sequence_id: str, services: Provided, caller: Reader) -> shapes.Sequence:
    """State, quality and thumbnail of a clip."""
    with services.reading() as unit:
        sequence = sequence_of(unit, caller, sequence_id)
        return shapes.Sequence.of(sequence, unit.jobs.latest(sequence_id, JobKind.CAPTURE))


@router.get(
    "/{sequence_id}/thumbnail",
    summary="A picture of the person",
    response_class=Response,
    responses={200: {"content": {"image/png": {}}}},
)
def read_thumbnail(sequence_id: str, services: Provided, caller: Reader) -> Response:
    """The person, cut out, as PNG."""
    with services.reading() as unit:
        sequence = sequence_of(unit, caller, sequence_id)
    if sequence.thumbnail_sha256 is None:
        raise NotFound(f"a thumbnail comes with the capture; got a {sequence.state} sequence; wait")
    picture = b"".join(services.objects.stream(sequence.person_id, sequence.thumbnail_sha256))
    headers = {"Cache-Control": "private, max-age=3600", "ETag": f'"{sequence.thumbnail_sha256}"'}
    return Response(picture, media_type="image/png", headers=headers)


@router.post("/{sequence_id}/models", status_code=status.HTTP_202_ACCEPTED, summary="Train a model")
def train_model(
    sequence_id: str, body: shapes.NewModel, services: Provided, caller: Writer
) -> shapes.Job:
    """Queue a training; follow it at `/v1/jobs/{id}/events`."""
    preset = find_preset(body.preset)
    longest = services.settings.max_budget_s
    if body.budget_s > longest:
        raise ProblemError(
            422,
            "invalid-input",
            f"budget_s must be at most {longest:g}; got {body.budget_s:g}; ask for less time",
        )
    with services.unit_of_work() as unit:
        sequence = sequence_of(unit, caller, sequence_id)
        if sequence.kind is SequenceKind.KEYPOINTS:
            raise ProblemError(
                422,
                "keypoints-only",
                "a model must be trained from pictures of the person; got keypoints alone, which "
                "have no colours; they can drive a model (`motion_sequence_id` of a view), or "
                "upload a video",
            )
        if sequence.state is not SequenceState.READY:
            raise ProblemError(
                409,
                "not-captured",
                f"a sequence must be ready before it is trained from; got {sequence.state}; "
                "wait for its capture",
            )
        params = {"preset": preset.name, "budget_s": body.budget_s, "seed": body.seed}
        job = enqueue(unit, JobKind.TRAIN, sequence, params, services.clock())
        unit.commit()
    services.events.publish(QUEUE)
    return shapes.Job.of(job)
