"""Recordings of meetings: list, read, show again, make a video, take oneself out, delete."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Response, status
from fastapi.responses import StreamingResponse

from db.errors import NotFound
from db.models import JobKind, JobRow, JobState, Purpose, RecordingState, new_id
from services import audit
from services.access import has_part, is_mine, recording_of, require_part
from services.api import recording_shapes, shapes
from services.api.dependencies import Joiner, Provided, Writer
from services.api.environments import (
    PICTURE,
    Environment,
    IfNoneMatch,
    own_environment,
    picture_answer,
)
from services.api.gzipped import ENCODED, VARIES, AcceptEncoding, gzipped, takes_gzip
from services.auth import INVITED, Principal
from services.container import Services
from services.errors import NoOwnPerson, StillRecording
from services.jobs.events import QUEUE
from services.likeness import require_consent, require_consents, shown_chunks
from services.person_models import VIEWER_FILE
from services.problems import PROBLEMS
from services.recording import consent, replay
from services.recording.ogg import ogg_opus, with_silence

router = APIRouter(prefix="/v1/recordings", tags=["recordings"], responses=PROBLEMS)

_BYTES: dict[int | str, dict[str, Any]] = {200: {"content": {"application/octet-stream": {}}}}


@router.get("", summary="List your recordings")
def list_recordings(services: Provided, caller: Joiner) -> recording_shapes.Recordings:
    """Recordings that the token's account started or agreed to, the newest first."""
    with services.reading() as unit:
        found = unit.recordings.of_account(caller.account)
    return recording_shapes.Recordings(
        items=[
            recording_shapes.Recording.of(one, caller.account)
            for one in found
            if has_part(one, caller)
        ]
    )


@router.get("/{recording_id}", summary="Read a recording")
def read_recording(
    recording_id: str, services: Provided, caller: Joiner
) -> recording_shapes.RecordingInFull:
    """Participants and tracks, for those who agreed and for whoever started the recording; without
    the tracks of people whose consent does not cover recordings now."""
    with services.reading() as unit:
        recording = recording_of(unit, caller, recording_id)
        chunks = shown_chunks(unit, recording_id, services.clock())
        videos = unit.recordings.exports([recording_id])
    sizes: dict[str, int] = {}
    for chunk in chunks:
        sizes[chunk.track] = sizes.get(chunk.track, 0) + chunk.bytes
    base = f"/v1/recordings/{recording_id}"
    return recording_shapes.RecordingInFull(
        **dict(recording_shapes.Recording.of(recording, caller.account)),
        tracks=[
            recording_shapes.RecordedTrack(name=name, bytes=size, url=f"{base}/tracks/{name}")
            for name, size in sizes.items()
        ],
        videos=[
            recording_shapes.RecordedVideo(
                job_id=one.job_id, bytes=one.bytes, url=f"{base}/videos/{one.job_id}"
            )
            for one in videos
        ],
    )


@router.get(
    "/{recording_id}/tracks/{track}",
    summary="Download a track",
    response_class=StreamingResponse,
    responses=_BYTES,
)
def read_track(
    recording_id: str, track: str, services: Provided, caller: Joiner
) -> StreamingResponse:
    """The track's records, decompressed (`services.recording.chunks`)."""
    data = _track(services, caller, recording_id, track)
    return StreamingResponse(data, media_type="application/octet-stream")


@router.get(
    "/{recording_id}/voices/{participant_id}.ogg",
    summary="Download a voice",
    response_class=StreamingResponse,
    responses={200: {"content": {"audio/ogg": {}}}},
)
def read_voice(
    recording_id: str, participant_id: str, services: Provided, caller: Joiner
) -> StreamingResponse:
    """A participant's voice as Ogg Opus, in time with the recording."""
    data = _track(services, caller, recording_id, f"voice:{participant_id}")
    pages = ogg_opus(with_silence(replay.records(data)))
    return StreamingResponse(pages, media_type="audio/ogg")


@router.get(
    "/{recording_id}/models/{model_id}",
    summary="Download a performer's splats",
    response_class=StreamingResponse,
    responses=_BYTES,
)
def read_model(
    recording_id: str,
    model_id: str,
    services: Provided,
    caller: Joiner,
    accept_encoding: AcceptEncoding = "",
) -> StreamingResponse:
    """The viewer's file of a performer who moves in the recording; compressed where the caller
    takes gzip."""
    with services.reading() as unit:
        recording_of(unit, caller, recording_id)
        row = unit.models.get(model_id)
        moves = recording_id in unit.recordings.with_person(row.person_id)
        if moves:
            person = unit.people.get(row.person_id)
            require_consent(person, Purpose.RECORDINGS, services.clock())
    files = [file for file in row.files if file.name == VIEWER_FILE]
    if not (moves and files):
        raise NotFound(
            f"id must be that of a model of splats that moves in the recording; got {model_id!r}"
        )
    data, headers = services.objects.stream(row.person_id, files[0].sha256), VARIES
    if takes_gzip(accept_encoding):
        data, headers = gzipped(data), VARIES | ENCODED
    return StreamingResponse(data, media_type="application/octet-stream", headers=headers)


@router.get("/{recording_id}/place", summary="Read the uploaded environment")
def read_place(recording_id: str, services: Provided, caller: Joiner) -> Environment:
    """The environment that the host uploaded; all others are in the library."""
    with services.reading() as unit:
        own = unit.meetings.panorama(recording_of(unit, caller, recording_id).meeting_id)
        if own is None:
            raise _no_place()
        return own_environment(own, f"/v1/recordings/{recording_id}/place/picture")


@router.get(
    "/{recording_id}/place/picture",
    summary="Download the uploaded environment",
    response_class=Response,
    responses=PICTURE,
)
def read_picture(
    recording_id: str, services: Provided, caller: Joiner, if_none_match: IfNoneMatch = None
) -> Response:
    """The equirectangular picture that the host uploaded."""
    with services.reading() as unit:
        recording = recording_of(unit, caller, recording_id)
        picture = unit.meetings.panorama_picture(recording.meeting_id)
    if picture is None:
        raise _no_place()
    return picture_answer(picture, if_none_match, "private, no-cache")


@router.delete("/{recording_id}", summary="Delete a recording")
def delete_recording(recording_id: str, services: Provided, caller: Writer) -> Response:
    """Delete a recording and every video made of it. Only whoever started it may."""
    with services.unit_of_work() as unit:
        recording = unit.recordings.get_for_change(recording_id)
        caller.require_account(recording.account)
        gone = unit.recordings.remove(recording)
        audit.note(services, unit, caller.account, "recording.deleted")
        unit.commit()
    replay.drop(services, gone)
    return Response(status_code=status.HTTP_204_NO_CONTENT)


@router.delete("/{recording_id}/mine", summary="Remove yourself from a recording")
def leave_recording(
    recording_id: str, services: Provided, caller: Joiner
) -> recording_shapes.RemovedFromRecording:
    """Delete the account's motion, voice and words, or those of the seat of somebody who came by
    an invitation; a recording that still runs ends."""
    with services.unit_of_work() as unit:
        recording = unit.recordings.get_for_change(recording_id)
        require_part(recording, caller)
        consent.end(recording, "somebody took themselves out", services.clock())
        seat = caller.participant_id if caller.account == INVITED else None
        chunks = unit.recordings.drop_chunks(recording_id, caller.account, seat)
        videos = unit.recordings.drop_exports([recording_id])
        for member in [one for one in recording.members if is_mine(one, caller)]:
            recording.members.remove(member)
        audit.note(services, unit, caller.account, "recording.left")
        unit.commit()
    gone = [(one.owner, one.sha256) for one in chunks]
    replay.drop(services, gone + [(one.person_id, one.sha256) for one in videos])
    return recording_shapes.RemovedFromRecording(chunks=len(chunks), videos=len(videos))


@router.post("/{recording_id}/export", status_code=status.HTTP_202_ACCEPTED, summary="Make a video")
def export_recording(
    recording_id: str, body: recording_shapes.NewVideo, services: Provided, caller: Writer
) -> shapes.Job:
    """Queue an MP4 along a camera's path; follow it at `/v1/jobs/{id}/events`.

    It is kept under a person of the caller's, and goes with anybody who is seen in it.
    """
    with services.unit_of_work() as unit:
        recording = recording_of(unit, caller, recording_id)
        if recording.state is not RecordingState.ENDED:
            raise StillRecording("a recording must have ended; got one under way; end it")
        people = unit.people.of_account(caller.account)
        if not people:
            raise NoOwnPerson(
                "a video must be kept under a person of yours; got an account without one; "
                "enrol first",
            )
        now = services.clock()
        job = JobRow(
            id=new_id(),
            person_id=people[0].id,
            kind=JobKind.EXPORT,
            state=JobState.QUEUED,
            params={"recording_id": recording_id} | body.model_dump(mode="json"),
            created_at=now,
            message="waiting for a worker",
            progress=0.0,
            preview_version=0,
            attempt=0,
            crashes=0,
            cancel_requested=False,
            traceparent=services.tracing.here(),
        )
        unit.jobs.add(job)
        audit.note(services, unit, caller.account, "recording.exported", people[0].id)
        unit.commit()
    services.events.publish(QUEUE)
    return shapes.Job.of(job)


@router.get(
    "/{recording_id}/videos/{job_id}",
    summary="Download a video",
    response_class=StreamingResponse,
    responses={200: {"content": {"video/mp4": {}}}},
)
def read_video(
    recording_id: str, job_id: str, services: Provided, caller: Joiner
) -> StreamingResponse:
    """The MP4 that an export has made, while everybody in it consents to recordings."""
    with services.reading() as unit:
        recording_of(unit, caller, recording_id)
        videos = unit.recordings.exports([recording_id])
        found = next((one for one in videos if one.job_id == job_id), None)
        if found is None:
            raise NotFound(f"id must be that of an export that succeeded; got {job_id!r}")
        require_consents(unit, found, services.clock())
    data = services.objects.stream(found.person_id, found.sha256)
    return StreamingResponse(data, media_type="video/mp4")


def _track(services: Services, caller: Principal, recording_id: str, track: str):
    with services.reading() as unit:
        recording_of(unit, caller, recording_id)
        chunks = shown_chunks(unit, recording_id, services.clock(), track)
    if not chunks:
        raise NotFound(f"a track must be one that the recording has; got {track!r}; read it first")
    return replay.unpacked(services, chunks)


def _no_place() -> NotFound:
    return NotFound(
        "the recorded meeting must have had a place of its own; got one held in a place of the "
        "library; see /v1/environments",
    )
