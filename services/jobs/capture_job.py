"""The job that turns an uploaded clip into a stored sequence."""

from __future__ import annotations

from pathlib import Path

from capture.errors import CaptureStopped
from capture.storage import open_sequence, read_quality
from db.errors import NotFound
from db.models import JobRow, MotionRow, PersonRow, SequenceKind, SequenceRow, SequenceState
from db.objects import fetch
from db.repositories import UnitOfWork
from scene.sequence import Sequence
from services.container import Services
from services.jobs.capture_apart import CaptureListener, capture_apart
from services.jobs.first_likeness import make_first_likeness
from services.jobs.queue import clip_gone
from services.jobs.report import JobStopped, Reporter, encode_preview
from services.jobs.results import Results

_SHARE_OF_CAPTURE = 0.95
"""Of the progress bar; the rest is packing and storing."""


def run_capture(services: Services, job: JobRow, reporter: Reporter, folder: Path) -> None:
    """Capture the job's sequence in `folder`. Raises ClipGone, CaptureError, JobStopped."""
    sequence, person = _begin(services, job)

    def on_progress(share: float, message: str) -> None:
        reporter.progress(share * _SHARE_OF_CAPTURE, message)

    source = folder / f"source{_suffix(sequence)}"
    try:
        fetch(services.objects, job.person_id, sequence.source_sha256, source)
    except NotFound as error:
        raise clip_gone() from error
    listener = CaptureListener(
        on_progress,
        lambda draft: make_first_likeness(services, job, reporter, draft),
        reporter.should_stop,
    )
    try:
        out = capture_apart(
            services.settings, source, folder, person.name, person.height_m, listener
        )
    except CaptureStopped as stopped:
        raise JobStopped from stopped
    reporter.progress(_SHARE_OF_CAPTURE, "storing")
    source.unlink()
    with services.tracing.span("store the sequence"):
        _store(services, job, out)


def _begin(services: Services, job: JobRow) -> tuple[SequenceRow, PersonRow]:
    if job.sequence_id is None:
        raise clip_gone()
    with services.unit_of_work() as unit:
        sequence = unit.sequences.get(job.sequence_id)
        sequence.state = SequenceState.CAPTURING
        person = unit.people.get(job.person_id)
        unit.commit()
    return sequence, person


def _suffix(sequence: SequenceRow) -> str:
    if sequence.kind is SequenceKind.FRAMES:
        return ".zip"
    return Path(sequence.source_name).suffix.lower() or ".mp4"


def _store(services: Services, job: JobRow, folder: Path) -> None:
    clip = open_sequence(folder)
    quality = read_quality(folder)
    with Results(services, job) as results:
        packed = results.pack(folder)
        motion = results.put_file(folder / "motion.npz")
        thumbnail = results.put_bytes(_thumbnail(clip))

        def write(unit: UnitOfWork, row: JobRow) -> str:
            assert row.sequence_id is not None
            sequence = unit.sequences.get(row.sequence_id)
            sequence.state = SequenceState.READY
            sequence.packed_sha256 = packed.sha256
            sequence.thumbnail_sha256 = thumbnail.sha256
            sequence.frames = len(clip.train)
            sequence.frames_per_second = clip.frames_per_second
            sequence.duration_s = clip.motion.duration_s
            sequence.quality = quality
            unit.motions.add(
                MotionRow(
                    person_id=row.person_id,
                    sequence_id=sequence.id,
                    frames=len(clip.motion),
                    duration_s=clip.motion.duration_s,
                    sha256=motion.sha256,
                )
            )
            return f"captured {len(clip.train)} frames"

        results.commit(write)


def _thumbnail(clip: Sequence) -> bytes:
    """The person of the middle frame, cut out over grey."""
    frame = clip.frame(len(clip.train) // 2)
    alpha = frame.mask[..., None]
    return encode_preview(frame.image + 0.9 * (1.0 - alpha))
