"""Models: what was trained, its files, and views of it."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

from fastapi import APIRouter, Header, Response
from fastapi.responses import RedirectResponse, StreamingResponse

from db.errors import NotFound
from db.models import ModelFileRow, ModelRow, Purpose
from db.repositories import UnitOfWork
from scene.errors import InvalidInput
from services.access import model_of, sequence_of
from services.api import shapes
from services.api.dependencies import Joiner, Provided, Reader
from services.api.gzipped import ENCODED, VARIES, AcceptEncoding, gzipped, takes_gzip
from services.api.view_shapes import NewView
from services.auth import GUEST, Principal
from services.container import Services
from services.errors import NotInMeeting
from services.likeness import require_consent
from services.motions import motion_of
from services.person_models import VIEWER_FILE
from services.problems import PROBLEMS
from services.seats import require_admitted
from services.views import MEDIA_TYPES, render_view

router = APIRouter(prefix="/v1/models", tags=["models"], responses=PROBLEMS)


@router.get("", summary="List your models")
def list_models(services: Provided, caller: Reader) -> shapes.Models:
    """The models that the demo lends, then those of the token's account, the oldest first."""
    with services.reading() as unit:
        models = unit.models.of_account(caller.account)
        if caller.may_use(GUEST) and caller.account != GUEST:
            models = unit.models.of_account(GUEST) + models
    return shapes.Models(items=[shapes.Model.of(model) for model in models])


@router.get("/{model_id}", summary="Read a model")
def read_model(model_id: str, services: Provided, caller: Reader) -> shapes.Model:
    """Metrics and files of a model."""
    with services.reading() as unit:
        return shapes.Model.of(model_of(unit, caller, model_id))


_FILE_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {"content": {"application/octet-stream": {}}},
    304: {"description": "Kept."},
}
IfNoneMatch = Annotated[str | None, Header()]


@router.get(
    f"/{{model_id}}/files/{VIEWER_FILE}",
    summary="Download the viewer's file",
    response_class=StreamingResponse,
    responses=_FILE_RESPONSES | {204: {"description": "A model that no page can draw."}},
)
def read_viewer_file(
    model_id: str,
    services: Provided,
    caller: Joiner,
    if_none_match: IfNoneMatch = None,
    accept_encoding: AcceptEncoding = "",
) -> Response:
    """The splats that a page draws by itself: to the owner, and to whoever is in a meeting in which
    the model is shown. Its ETag is its sha256, and it never changes, but whether it may be had is
    asked each time: 304 where the caller has it. Compressed where the caller takes gzip. A model
    that is not made of splats has none: 204."""
    with services.reading() as unit:
        model = _shown_to(unit, caller, model_id, services.clock())
    if all(file.name != VIEWER_FILE for file in model.files):
        return Response(status_code=204)
    compressed = takes_gzip(accept_encoding)
    response = _file(services, model, VIEWER_FILE, if_none_match, compressed=compressed)
    response.headers.update(VARIES)
    return response


@router.get(
    "/{model_id}/files/{name}",
    summary="Download a file",
    response_class=StreamingResponse,
    responses=_FILE_RESPONSES | {307: {"description": "At the store, for a minute."}},
)
def read_file(
    model_id: str,
    name: str,
    services: Provided,
    caller: Reader,
    if_none_match: IfNoneMatch = None,
) -> Response:
    """A file of the model, streamed; its ETag is its sha256, and it never changes. Where the store
    can be reached from outside: 307 to an address of it, which needs no token and is good for a
    minute."""
    with services.reading() as unit:
        model = model_of(unit, caller, model_id)
    file = _named(model, name)
    address = services.objects.signed_address(model.person_id, file.sha256)
    if address is None or _has(file, if_none_match):
        return _file(services, model, name, if_none_match)
    return RedirectResponse(address, headers={"Cache-Control": "no-store"})


@router.post(
    "/{model_id}/views",
    summary="Render a view",
    response_class=Response,
    responses={200: {"content": {kind: {} for kind in MEDIA_TYPES.values()}}},
)
def make_view(model_id: str, body: NewView, services: Provided, caller: Reader) -> Response:
    """A picture of the person, from any side, at any moment of a motion or in any pose."""
    longest = services.settings.models.max_view_px
    if max(body.width, body.height) > longest:
        raise InvalidInput(
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


def _shown_to(unit: UnitOfWork, caller: Principal, model_id: str, now: datetime) -> ModelRow:
    """The model, if it is the caller's or is shown in the meeting that they are in."""
    if caller.meeting_id is None:
        return model_of(unit, caller, model_id)
    meeting = unit.meetings.get(caller.meeting_id)
    require_admitted(meeting, caller)
    found = [performer for performer in meeting.performers if performer.model_id == model_id]
    if not found:
        raise NotInMeeting(
            f"the model must stand in the meeting that the token is for; got {model_id!r}, which "
            "does not; read the meeting to see who does",
        )
    require_consent(found[0].person, Purpose.MEETINGS, now)
    return unit.models.get(model_id)


def _named(model: ModelRow, name: str) -> ModelFileRow:
    for file in model.files:
        if file.name == name:
            return file
    names = ", ".join(file.name for file in model.files)
    raise NotFound(f"name must be one of {names}; got {name!r}")


def _has(file: ModelFileRow, if_none_match: str | None) -> bool:
    return if_none_match is not None and file.sha256 in if_none_match


def _file(
    services: Services,
    model: ModelRow,
    name: str,
    if_none_match: str | None,
    *,
    compressed: bool = False,
) -> Response:
    file = _named(model, name)
    etag = f'"{file.sha256}-gzip"' if compressed else f'"{file.sha256}"'
    headers = {"ETag": etag, "Cache-Control": "private, no-cache"}
    if _has(file, if_none_match):
        return Response(status_code=304, headers=headers)
    pieces = services.objects.stream(model.person_id, file.sha256)
    headers["Content-Disposition"] = f'attachment; filename="{file.name}"'
    return StreamingResponse(
        gzipped(pieces) if compressed else pieces,
        media_type="application/octet-stream",
        headers=headers | (ENCODED if compressed else {"Content-Length": str(file.bytes)}),
    )
