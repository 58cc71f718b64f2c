"""Models: what was trained, its files, and views of it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Header, Response
from fastapi.responses import StreamingResponse

from db.errors import NotFound
from services.access import model_of, sequence_of
from services.api import shapes
from services.auth import Reader
from services.container import Provided
from services.motions import motion_of
from services.problems import PROBLEMS, ProblemError
from services.views import MEDIA_TYPES, render_view

router = APIRouter(prefix="/v1/models", tags=["models"], responses=PROBLEMS)


@router.get("", summary="List your models")
def list_models(services: Provided, caller: Reader) -> shapes.Models:
    """The models of the token's account, the oldest first."""
    with services.reading() as unit:
        models = unit.models.of_account(caller.account)
    return shapes.Models(items=[shapes.Model.of(model) for model in models])


@router.get("/{model_id}", summary="Read a model")
def read_model(model_id: str, services: Provided, caller: Reader) -> shapes.Model:
    """Metrics and files of a model."""
    with services.reading() as unit:
        return shapes.Model.of(model_of(unit, caller, model_id))


@router.get(
    "/{model_id}/files/{name}",
    summary="Download a file",
    response_class=StreamingResponse,
    responses={200: {"content": {"application/octet-stream": {}}}, 304: {"description": "Kept."}},
)
def read_file(
    model_id: str,
    name: str,
    services: Provided,
    caller: Reader,
    if_none_match: Annotated[str | None, Header()] = None,
) -> Response:
    """A file of the model, streamed; its ETag is its sha256, and it never changes."""
    with services.reading() as unit:
        model = model_of(unit, caller, model_id)
    found = [file for file in model.files if file.name == name]
    if not found:
        names = ", ".join(file.name for file in model.files)
        raise NotFound(f"name must be one of {names}; got {name!r}")
    (file,) = found
    headers = {"ETag": f'"{file.sha256}"', "Cache-Control": "private, max-age=31536000, immutable"}
    if if_none_match is not None and file.sha256 in if_none_match:
        return Response(status_code=304, headers=headers)
    return StreamingResponse(
        services.objects.stream(model.person_id, file.sha256),
        media_type="application/octet-stream",
        headers=headers
        | {
            "Content-Length": str(file.bytes),
            "Content-Disposition": f'attachment; filename="{file.name}"',
        },
    )


@router.post(
    "/{model_id}/views",
    summary="Render a view",
    response_class=Response,
    responses={200: {"content": {kind: {} for kind in MEDIA_TYPES.values()}}},
)
def make_view(model_id: str, body: shapes.NewView, services: Provided, caller: Reader) -> Response:
    """A picture of the person, from any side, at any moment of a motion or in any pose."""
    longest = services.settings.max_view_px
    if max(body.width, body.height) > longest:
        raise ProblemError(
            422,
            "invalid-input",
            f"width and height must be at most {longest} px; got {body.width} x {body.height}; "
            "ask for fewer",
        )
    with services.reading() as unit:
        row = model_of(unit, caller, model_id)
        motion = None
        if body.motion_sequence_id is not None:
            sequence_of(unit, caller, body.motion_sequence_id)
            motion = motion_of(services, unit, body.motion_sequence_id)
    model = services.models.load_row(row)
    picture = render_view(model, motion or model.motion, body)
    return Response(picture, media_type=MEDIA_TYPES[body.format])
