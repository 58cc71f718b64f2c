"""Uploads: a clip in one request, or in pieces that survive a broken connection."""

from __future__ import annotations

from fastapi import APIRouter, Header, Request, Response, status
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse

from db.models import JobKind, SequenceRow, UploadChunkRow, UploadRow, new_id
from db.objects import file_chunks
from services.access import person_of
from services.api import shapes
from services.api.dependencies import CurrentGateway, Provided, Writer
from services.api.receive import receive_file, receive_raw
from services.auth import Principal
from services.container import Services
from services.errors import WrongHash, WrongOffset
from services.jobs.queue import Orphan, drop_orphans
from services.problems import PROBLEMS, problems
from services.quotas import require_room
from services.uploads.ingest import ReceivedFile, end_upload, existing_sequence, ingest, safe_name
from services.uploads.spool import Spool, join, spool, too_large

router = APIRouter(prefix="/v1", tags=["sequences"], responses=PROBLEMS)

_FORM = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["file"],
                    "properties": {
                        "file": {
                            "type": "string",
                            "format": "binary",
                            "description": "A video, a zip of frames or videos, or JSON keypoints.",
                        }
                    },
                }
            }
        },
    }
}
_RAW = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}


@router.post(
    "/people/{person_id}/sequences",
    status_code=status.HTTP_202_ACCEPTED,
    summary="Upload a clip",
    openapi_extra=_FORM,
    responses=problems(413, 507),
)
async def upload_clip(
    person_id: str, request: Request, gateway: CurrentGateway, services: Provided, caller: Writer
) -> shapes.Sequence:
    """Take a clip as the form's field `file`; its capture starts by itself."""
    await run_in_threadpool(_require_person, services, caller, person_id)
    told_bytes = int(request.headers.get("content-length", 0))
    await run_in_threadpool(require_room, services, caller.account, more_bytes=told_bytes)
    settings = services.settings
    with spool(settings.folders.scratch_dir, settings.uploads.max_bytes) as received:
        await receive_file(request, received)
        return await gateway.turns.run(
            caller.counted_as, _store, services, caller, person_id, received
        )


@router.post(
    "/people/{person_id}/uploads",
    status_code=status.HTTP_201_CREATED,
    summary="Begin an upload in pieces",
    response_model=shapes.Upload | shapes.ExistingSequence,
)
def begin_upload(
    person_id: str, body: shapes.NewUpload, services: Provided, caller: Writer
) -> Response:
    """Begin an upload, go on with one of the same bytes, or learn that they are here already."""
    limit = services.settings.uploads.max_bytes
    if body.size > limit:
        raise too_large(limit, str(body.size))
    _require_person(services, caller, person_id)
    known = existing_sequence(services, person_id, body.sha256)
    if known is not None:
        answer = shapes.ExistingSequence(sequence=_with_capture(services, known))
        return JSONResponse(answer.model_dump(mode="json"), status_code=200)
    with services.reading() as unit:
        begun = unit.uploads.with_content(person_id, body.sha256)
    if begun is None or begun.size != body.size:
        require_room(services, caller.account, sequences=1, more_bytes=body.size)
    with services.unit_of_work() as unit:
        upload = unit.uploads.with_content(person_id, body.sha256)
        if upload is None or upload.size != body.size:
            upload = UploadRow(
                id=new_id(),
                person_id=person_id,
                filename=safe_name(body.filename),
                size=body.size,
                sha256=body.sha256,
                created_at=services.clock(),
            )
            unit.uploads.add(upload)
        answer = shapes.Upload(id=upload.id, offset=upload.offset)
        unit.commit()
    return JSONResponse(answer.model_dump(), status_code=201)


@router.head("/uploads/{upload_id}", summary="How far an upload is", response_class=Response)
def upload_offset(upload_id: str, services: Provided, caller: Writer) -> Response:
    """`Upload-Offset`: the bytes that have come."""
    with services.reading() as unit:
        upload = unit.uploads.get(upload_id)
        person_of(unit, caller, upload.person_id)
    return Response(headers=_offset(upload) | {"Cache-Control": "no-store"})


@router.patch(
    "/uploads/{upload_id}",
    summary="Send the next piece",
    openapi_extra=_RAW,
    status_code=status.HTTP_204_NO_CONTENT,
    responses={
        202: {"description": "The last piece: the sequence.", "model": shapes.Sequence},
    }
    | problems(409),
)
async def send_piece(
    upload_id: str,
    request: Request,
    gateway: CurrentGateway,
    services: Provided,
    caller: Writer,
    upload_offset: int = Header(ge=0, description="Where this piece begins."),
) -> Response:
    """Append a piece. What came before a broken connection is kept; ask HEAD where to go on."""
    upload = await run_in_threadpool(_find_upload, services, caller, upload_id)
    if upload_offset != upload.offset:
        raise _wrong_offset(upload, upload_offset)
    folder = services.settings.folders.scratch_dir
    with spool(folder, upload.size - upload.offset) as piece:
        await receive_raw(request, piece)
        upload = await run_in_threadpool(_append, services, upload, piece)
    if upload.offset < upload.size:
        return Response(status_code=204, headers=_offset(upload))
    with spool(folder, upload.size) as whole:
        sequence = await gateway.turns.run(
            caller.counted_as, _complete, services, caller, upload, whole
        )
    return JSONResponse(sequence.model_dump(mode="json"), status_code=202, headers=_offset(upload))


@router.delete("/uploads/{upload_id}", summary="Give an upload up", status_code=204)
def give_up_upload(upload_id: str, services: Provided, caller: Writer) -> Response:
    """Delete an upload under way, with every piece that has come."""
    _forget(services, _find_upload(services, caller, upload_id))
    return Response(status_code=204)


def _require_person(services: Services, caller: Principal, person_id: str) -> None:
    with services.reading() as unit:
        person_of(unit, caller, person_id)


def _find_upload(services: Services, caller: Principal, upload_id: str) -> UploadRow:
    with services.reading() as unit:
        upload = unit.uploads.get(upload_id)
        person_of(unit, caller, upload.person_id)
    return upload


def _store(
    services: Services,
    caller: Principal,
    person_id: str,
    received: Spool,
    *,
    has_room: bool = False,
) -> shapes.Sequence:
    sequence = existing_sequence(services, person_id, received.sha256)
    if sequence is None:
        if not has_room:  # its size is known only now where the sender did not tell it
            require_room(services, caller.account, sequences=1, more_bytes=received.size)
        file = ReceivedFile(
            person_id, caller.account, received.path, received.filename, received.sha256
        )
        sequence = ingest(services, file)
    return _with_capture(services, sequence)


def _with_capture(services: Services, sequence: SequenceRow) -> shapes.Sequence:
    with services.reading() as unit:
        capture = unit.jobs.latest(sequence.id, JobKind.CAPTURE)
    return shapes.Sequence.of(sequence, capture)


def _append(services: Services, upload: UploadRow, piece: Spool) -> UploadRow:
    if piece.size == 0:
        return upload
    stored = services.objects.put(upload.person_id, file_chunks(piece.path))
    try:
        with services.unit_of_work() as unit:
            current = unit.uploads.get(upload.id)
            if current.offset != upload.offset:  # somebody else sends the same file
                raise _wrong_offset(current, upload.offset)
            current.chunks.append(
                UploadChunkRow(
                    start=upload.offset,
                    person_id=upload.person_id,
                    bytes=stored.bytes,
                    sha256=stored.sha256,
                )
            )
            unit.commit()
    except BaseException:
        drop_orphans(services, [(upload.person_id, stored.sha256)])
        raise
    return current


def _complete(
    services: Services, caller: Principal, upload: UploadRow, whole: Spool
) -> shapes.Sequence:
    for chunk in upload.chunks:
        join(services.objects.stream(upload.person_id, chunk.sha256), whole)
    try:
        whole.close()
        if whole.sha256 != upload.sha256:
            raise WrongHash(
                f"the file's sha256 must be {upload.sha256}; got {whole.sha256}; upload it again",
            )
        whole.filename = upload.filename
        return _store(services, caller, upload.person_id, whole, has_room=True)
    finally:
        _forget(services, upload)


def _forget(services: Services, upload: UploadRow) -> None:
    orphans: list[Orphan] = []
    with services.unit_of_work() as unit:
        orphans = end_upload(unit, unit.uploads.get(upload.id))
        unit.commit()
    drop_orphans(services, orphans)


def _offset(upload: UploadRow) -> dict[str, str]:
    return {"Upload-Offset": str(upload.offset), "Upload-Length": str(upload.size)}


def _wrong_offset(upload: UploadRow, got: int) -> WrongOffset:
    return WrongOffset(
        f"Upload-Offset must be {upload.offset}, where the last piece ended; got {got}; "
        "go on from there",
        upload.offset,
        upload.size,
    )
