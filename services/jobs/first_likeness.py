"""A first likeness: a model that can be met while its clip is still being captured.

The fit takes most of a capture, but poses are about right after its first stage. If a training of
splats waits for the clip, it is given a model made in seconds from what is known by then; the
training's first round takes that model's place, wherever it stands.
"""

from __future__ import annotations

import logging
import time
from pathlib import Path

from capture.storage import open_sequence
from db.models import JobKind, JobRow, JobState
from db.repositories import UnitOfWork
from renderer.errors import TrainingStopped
from renderer.performer_model import PerformerModel
from renderer.training import Progress, train
from scene.errors import SceneError
from services.container import Services
from services.jobs.events import job_topic
from services.jobs.report import JobStopped, Reporter
from services.jobs.results import Results
from services.jobs.train_job import FIRST_USABLE_S, stored_model

log = logging.getLogger(__name__)


def make_first_likeness(
    services: Services, capture: JobRow, reporter: Reporter, draft: Path
) -> None:
    """Train a model of the sequence folder `draft` for whoever waits for it, if anybody does.

    Raises JobStopped. Where training finds no likeness the capture goes on without one.
    """
    training = _waiting(services, capture)
    if training is None:
        return

    def on_progress(step: Progress) -> None:
        if step.preview is not None:
            reporter.show(step.preview)

    try:
        model = train(
            open_sequence(draft),
            budget_s=FIRST_USABLE_S,
            seed=int(training.params["seed"]),
            on_progress=on_progress,
            should_stop=reporter.should_stop,
            clock=time.perf_counter,
        )
    except TrainingStopped as stopped:
        raise JobStopped from stopped
    except SceneError as error:
        log.warning("job %s: no first likeness: %s", capture.id, error)
        return
    model.metrics.update(round=0, train_seconds=FIRST_USABLE_S)
    if (training := _waiting(services, capture)) is not None:  # nobody has cancelled it meanwhile
        _publish(services, capture, training.id, model, draft.parent)


def _waiting(services: Services, capture: JobRow) -> JobRow | None:
    """The training that is to be given a likeness: it has none, nor an earlier model."""
    if capture.sequence_id is None:
        return None
    with services.reading() as unit:
        training = unit.jobs.latest(capture.sequence_id, JobKind.TRAIN)
    if training is None or training.state is not JobState.QUEUED or training.model_id is not None:
        return None
    makes_splats = training.params["preset"] == "splats"
    return training if makes_splats and training.params.get("improves") is None else None


def _publish(
    services: Services, capture: JobRow, training_id: str, model: PerformerModel, scratch: Path
) -> None:
    with Results(services, capture) as results:
        row = stored_model(services, capture, results, model, scratch)

        def write(unit: UnitOfWork, _: JobRow) -> str:
            unit.models.add(row)
            unit.flush()
            unit.jobs.get(training_id).model_id = row.id
            return "a first likeness is ready"

        results.commit_interim(write)
    services.events.publish(job_topic(training_id))
