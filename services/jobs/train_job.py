"""The job that trains a person's model from a stored sequence.

A meeting need not wait for the best model: splats are trained in rounds, each going on from the
one before, and what a round has learnt is handed out at once. The next round's model takes its
place, in meetings too, where everybody sees it change.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from capture.storage import open_sequence
from db.errors import NotFound
from db.models import JobRow, ModelRow, Purpose, SequenceKind, SequenceRow, new_id
from db.objects import fetch
from db.repositories import UnitOfWork
from renderer.errors import TrainingStopped
from renderer.live_look.learning import with_kept
from renderer.performer_model import PerformerModel
from renderer.training import Progress, train
from scene.sequence import Sequence
from services.container import Services
from services.jobs.events import meeting_topic
from services.jobs.packing import unpack
from services.jobs.queue import clip_gone, frames_of
from services.jobs.report import JobStopped, Reporter
from services.jobs.results import Results
from services.likeness import require_consent
from services.meetings import measure
from services.person_models import store_files, write_files

FIRST_USABLE_S = 3.0
"""Training time after which splats can be met."""
_LONGER = 4.0
"""Each round ends at so many times the end of the one before."""
_LEAST_LAST_SHARE = 0.3
"""Of the whole time, for the last round: what it changes must be worth another version."""


def run_train(services: Services, job: JobRow, reporter: Reporter, folder: Path) -> None:
    """Train as the job's parameters say. Raises ClipGone, TrainingError, JobStopped.

    An earlier attempt's last round is gone on from, by the checkpoint that it left in the store.
    """
    with services.tracing.span("fetch the frames"):
        lesson = _fetch_lesson(services, job, folder)
    training = _Training(services, job, reporter, folder, lesson)
    budget_s = float(job.params["budget_s"])
    ends = [budget_s] if lesson.kept else round_ends(str(job.params["preset"]), budget_s)
    model, done = training.start(len(ends))
    for number in range(done, len(ends)):
        with services.tracing.span("train", attributes={"train.round": number}):
            model = training.round(number, ends, model)
        with services.tracing.span("store the model"):
            training.store(model, last=number + 1 == len(ends))


def round_ends(preset: str, budget_s: float) -> list[float]:
    """When each round of a training of `budget_s` ends, s of training; the last at `budget_s`."""
    ends, end = [], FIRST_USABLE_S
    while preset == "splats" and end <= (1.0 - _LEAST_LAST_SHARE) * budget_s:
        ends.append(end)
        end *= _LONGER
    return [*ends, budget_s]


@dataclass(frozen=True, eq=False)
class _Lesson:
    """What is learnt from."""

    clip: Sequence
    clip_id: str | None
    kept: list[Sequence]
    """Pictures of live look, with which an earlier model goes on to learn."""


class _Training:
    """The rounds of one attempt at a job."""

    def __init__(
        self,
        services: Services,
        job: JobRow,
        reporter: Reporter,
        folder: Path,
        lesson: _Lesson,
    ) -> None:
        self._services, self._job, self._reporter = services, job, reporter
        self._folder, self._model_id = folder, job.model_id
        self._lesson = lesson
        self._left = job.checkpoint_sha256

    def start(self, rounds: int) -> tuple[PerformerModel | None, int]:
        """What an earlier attempt has handed out and how many of `rounds` it has done, else the
        model that is to be bettered. A first likeness stands for the first round, but is no start:
        its body is that of an unfinished fit."""
        handed_out = self._load(self._model_id)
        if handed_out is None:
            return self._load(self._job.params.get("improves")), 0
        if (done := int(handed_out.metrics["round"])) > 0:
            return handed_out, done
        return None, min(1, rounds - 1)

    def _load(self, model_id: str | None) -> PerformerModel | None:
        if model_id is None:
            return None
        try:
            return self._services.models.load(model_id)
        except NotFound:  # erased meanwhile
            return None

    def round(self, number: int, ends: list[float], start: PerformerModel | None) -> PerformerModel:
        """Train until the end of round `number`; the model says which rounds are behind it.

        The light it was filmed in is found in the last alone, and how few splats are enough: either
        takes as long as a round.
        """
        begun = ends[number - 1] if number and start is not None else 0.0
        checkpoint = self._folder / f"round-{number}.checkpoint"
        if self._left is not None:
            with suppress(NotFound):  # gone: the round begins anew
                fetch(self._services.objects, self._job.person_id, self._left, checkpoint)
            self._left = None
        self._reporter.watch_checkpoint(checkpoint)
        length = ends[number] - begun

        def on_progress(step: Progress) -> None:
            share = (begun + step.fraction * length) / ends[-1]
            self._reporter.progress(share, step.message, step.preview)

        last = number + 1 == len(ends)
        clip, held_to = self._lesson.clip, 0
        if self._lesson.kept:
            if start is None:
                raise clip_gone()
            clip, held_to = with_kept(clip, self._lesson.kept, start), len(clip.train)
        try:
            model = train(
                clip,
                preset=str(self._job.params["preset"]),
                budget_s=length,
                seed=int(self._job.params["seed"]),
                start=start,
                find_light=last,
                size="auto" if last else "full",
                held_to=held_to,
                on_progress=on_progress,
                should_stop=self._reporter.should_stop,
                checkpoint=checkpoint,
                clock=time.perf_counter,
            )
        except TrainingStopped as stopped:
            self._reporter.save_checkpoint()
            raise JobStopped from stopped
        model.metrics.update(round=number + 1, train_seconds=round(ends[number], 3))
        return model

    def store(self, model: PerformerModel, *, last: bool) -> None:
        """Store `model` in the place of what this job stored before."""
        meetings: list[str] = []
        with Results(self._services, self._job) as results:
            row = stored_model(self._services, self._job, results, model, self._folder)
            row.sequence_id = self._lesson.clip_id
            worse = self._model_id or self._job.params.get("improves")

            def write(unit: UnitOfWork, training: JobRow) -> str:
                if self._lesson.kept:
                    _require_learning(self._services, unit, self._job)
                unit.models.add(row)
                unit.flush()
                if worse is not None:
                    meetings.extend(unit.models.supersede(str(worse), row, row.created_at))
                    _measure_performers(unit, meetings, row, model)
                training.model_id = row.id
                return "the model is ready"

            if last:
                results.commit(write)
            else:
                results.commit_interim(write)
        self._model_id = row.id
        for meeting_id in meetings:
            self._services.events.publish(meeting_topic(meeting_id))


def stored_model(
    services: Services, job: JobRow, results: Results, model: PerformerModel, scratch: Path
) -> ModelRow:
    """The row, still to be added, of a `model` that `job` made; its files are in the store."""
    files = scratch / f"files-{model.metrics['round']}"
    files.mkdir()
    return ModelRow(
        id=new_id(),
        person_id=job.person_id,
        sequence_id=job.sequence_id,
        preset=model.preset,
        created_at=services.clock(),
        data_hash=model.data_hash,
        metrics=model.metrics,
        files=store_files(results.put_file, job.person_id, write_files(model, files)),
    )


def _measure_performers(
    unit: UnitOfWork, meeting_ids: list[str], row: ModelRow, model: PerformerModel
) -> None:
    """Have whoever moves as in `model` from now on face the others by its motion."""
    for meeting_id in meeting_ids:
        for performer in unit.meetings.get(meeting_id).performers:
            if performer.model_id == row.id and performer.motion_sequence_id is None:
                measure(performer, model.skeleton, model.motion)


def _fetch_lesson(services: Services, job: JobRow, folder: Path) -> _Lesson:
    """What `job` is to learn from, fetched into `folder`. Raises ClipGone, NoConsent."""
    with services.reading() as unit:
        frames, clip_id, kept = frames_of(unit, job), job.sequence_id, list[str]()
        row = unit.sequences.get(clip_id) if clip_id is not None else None
        if row is not None and row.kind is SequenceKind.LIVE:
            _require_learning(services, unit, job)
            clip_id = row.clip_id
            clip = unit.sequences.get(clip_id) if clip_id is not None else None
            if clip is None or clip.packed_sha256 is None:
                raise clip_gone()
            frames, kept = clip.packed_sha256, _kept_with(unit, row)
    return _Lesson(
        _fetch_sequence(services, job, frames, folder / "sequence"),
        clip_id,
        [
            _fetch_sequence(services, job, sha256, folder / f"kept-{number}")
            for number, sha256 in enumerate(kept)
        ],
    )


def _kept_with(unit: UnitOfWork, newest: SequenceRow) -> list[str]:
    """sha256 of the pictures kept for the same clip until `newest`, in the order of their being
    kept: what an earlier round learnt is not to be forgotten."""
    rows = [
        one
        for one in unit.sequences.of_person(newest.person_id)
        if one.clip_id == newest.clip_id and one.created_at <= newest.created_at
    ]
    rows.sort(key=lambda one: (one.created_at, one.id))
    return [one.packed_sha256 for one in rows if one.packed_sha256 is not None]


def _require_learning(services: Services, unit: UnitOfWork, job: JobRow) -> None:
    require_consent(unit.people.get(job.person_id), Purpose.LEARNING, services.clock())


def _fetch_sequence(services: Services, job: JobRow, packed_sha256: str, folder: Path) -> Sequence:
    try:
        unpack(services.objects, job.person_id, packed_sha256, folder)
    except NotFound as error:
        raise clip_gone() from error
    return open_sequence(folder)
