"""The job that trains a person's model from a stored sequence."""

from __future__ import annotations

import time
from pathlib import Path

from capture.store import open_sequence
from db.models import JobRow, ModelRow, new_id
from db.objects import fetch
from db.repositories import UnitOfWork
from renderer.errors import TrainingStopped
from services.container import Services
from services.jobs.packing import unpack
from services.jobs.report import JobStopped, Reporter
from services.jobs.results import Results
from services.person_models import store_files, write_files


def run_train(services: Services, job: JobRow, reporter: Reporter, folder: Path) -> None:
    """Train as the job's parameters say. Raises TrainingError, JobStopped.

    A checkpoint that an earlier attempt left in the store is gone on from.
    """
    from renderer.relight_fit import with_albedo
    from renderer.training import Progress, train

    _fetch_sequence(services, job, folder / "sequence")
    checkpoint = folder / "model.checkpoint"
    if job.checkpoint_sha256 is not None:
        fetch(services.objects, job.person_id, job.checkpoint_sha256, checkpoint)
    reporter.watch_checkpoint(checkpoint)

    def on_progress(step: Progress) -> None:
        reporter.progress(step.fraction, step.message, step.preview)

    clip = open_sequence(folder / "sequence")
    try:
        model = train(
            clip,
            preset=str(job.params["preset"]),
            budget_s=float(job.params["budget_s"]),
            seed=int(job.params["seed"]),
            on_progress=on_progress,
            should_stop=reporter.should_stop,
            checkpoint=checkpoint,
            clock=time.perf_counter,
        )
    except TrainingStopped as stopped:
        reporter.save_checkpoint()
        raise JobStopped from stopped
    model = with_albedo(model, clip)
    (folder / "files").mkdir()
    files = write_files(model, folder / "files")
    with Results(services, job) as results:
        row = ModelRow(
            id=new_id(),
            person_id=job.person_id,
            sequence_id=job.sequence_id,
            preset=model.preset,
            created_at=services.clock(),
            data_hash=model.data_hash,
            metrics=model.metrics,
        )
        row.files = store_files(results.put_file, job.person_id, files)

        def write(unit: UnitOfWork, training: JobRow) -> str:
            unit.models.add(row)
            unit.flush()
            training.model_id = row.id
            return "the model is ready"

        results.hand_in(write)


def _fetch_sequence(services: Services, job: JobRow, folder: Path) -> None:
    if job.sequence_id is None:  # erased while the job waited
        raise JobStopped
    with services.reading() as unit:
        sequence = unit.sequences.get(job.sequence_id)
    if sequence.packed_sha256 is None:
        raise JobStopped
    unpack(services.objects, job.person_id, sequence.packed_sha256, folder)
