"""The same jobs on both homes: children of a worker, and tasks of a Ray cluster.

Rows lie in PostgreSQL, bytes in an S3 store, and wake-ups go by Redis, for a cluster's nodes share
nothing else with whoever leases jobs.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest
from sqlalchemy import create_engine, select

from capture.storage import open_sequence
from db.models import (
    JobKind,
    JobRow,
    JobState,
    ModelRow,
    PersonRow,
    SequenceKind,
    SequenceRow,
    SequenceState,
    new_id,
)
from renderer.evaluation.evaluate import evaluate
from services.composition import build_services
from services.container import Services
from services.jobs.queue import cancel, drop_orphans, enqueue
from services.settings import Settings
from tests.services import seeds
from tests.services.conftest import changed
from tests.services.jobs.homes import RayCluster, deployed, parent_of, working
from tests.services.jobs.waiting import child_of, until

pytestmark = pytest.mark.server
BUDGET_S = 4.5
"""Two rounds: a first model after 3 s, and the last."""
_CLOSE_DB = 2.0
"""Between two trainings of a few seconds on a machine that does much else."""


@pytest.fixture(scope="module")
def settings(
    tmp_path_factory: pytest.TempPathFactory, s3_endpoint: str, redis_url: str, pose_model: Path
) -> Iterator[Settings]:
    """Of a worker, and of nodes but for the folder."""
    folder = tmp_path_factory.mktemp("engines")
    more = {"pose_model": pose_model, "worker_slots": 2}
    with deployed(folder, redis_url, s3_endpoint, **more) as made:
        yield made


@pytest.fixture(scope="module")
def cluster(settings: Settings, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RayCluster]:
    made = RayCluster(settings, tmp_path_factory.mktemp("node"))
    made.start_head()
    made.add_node(cpus=2)
    yield made
    made.close()


@dataclass
class Home:
    """Where jobs run, and what there is to see of them."""

    engine: str
    settings: Settings
    services: Services

    def worker(self, *kinds: str):
        return working(self.settings, self.engine, *kinds or ("train",))

    def job(self, job_id: str) -> JobRow:
        with self.services.reading() as unit:
            return unit.jobs.get(job_id)

    def job_when(self, job_id: str, fits: Callable[[JobRow], bool], what: str) -> JobRow:
        return until(lambda: job if fits(job := self.job(job_id)) else None, what)

    def end(self, job_id: str) -> JobRow:
        return self.job_when(job_id, lambda job: job.state.final, "the end")

    def rounds(self, job: JobRow) -> list[int]:
        """Of which rounds of a training there are models, superseded ones too."""
        engine = create_engine(self.settings.database.url)
        with engine.connect() as connection:
            of_job = select(ModelRow.metrics).where(ModelRow.person_id == job.person_id)
            found = [metrics["round"] for (metrics,) in connection.execute(of_job)]
        engine.dispose()
        return sorted(found)

    def psnr_db(self, job: JobRow, folder: Path) -> float:
        """Of a training's model, in views that it did not learn from."""
        assert job.model_id is not None
        measured = evaluate(self.services.models.load(job.model_id), open_sequence(folder))
        return measured["psnr"]["novel_view"]["body_crop"]

    def kill(self, child: int) -> None:
        """End a job's process, and on a node what runs it, without a word."""
        if self.engine == "ray":
            os.kill(parent_of(child), signal.SIGKILL)
        os.kill(child, signal.SIGKILL)


@contextmanager
def a_home(engine: str, settings: Settings) -> Iterator[Home]:
    """A home whose queue is empty in the end."""
    services = build_services(settings)
    services.database.migrate()
    yield Home(engine, settings, services)
    with services.unit_of_work() as unit:
        orphans = []
        for job_id in _unfinished(settings):
            orphans += cancel(unit, unit.jobs.get(job_id), services.clock())
        unit.commit()
    drop_orphans(services, orphans)
    services.close()


@pytest.fixture(params=["local", "ray"])
def home(request: pytest.FixtureRequest, settings: Settings) -> Iterator[Home]:
    if request.param == "ray":
        cluster: RayCluster = request.getfixturevalue("cluster")
        settings = changed(settings, ray_address=cluster.address)
    with a_home(request.param, settings) as made:
        yield made


def _unfinished(settings: Settings) -> list[str]:
    engine = create_engine(settings.database.url)
    with engine.connect() as connection:
        left = select(JobRow.id).where(JobRow.state == JobState.QUEUED)
        found = [job_id for (job_id,) in connection.execute(left)]
    engine.dispose()
    return found


@pytest.fixture
def job_id(home: Home, sequence_folder: Path) -> str:
    """A training that waits."""
    sequence = seeds.captured(home.services, sequence_folder)
    return seeds.queued_training(home.services, sequence, BUDGET_S)


@pytest.fixture(scope="module")
def undisturbed_db(settings: Settings, sequence_folder: Path) -> float:
    """How good a training's model is that nobody disturbs, dB."""
    with a_home("local", settings) as home, home.worker():
        sequence = seeds.captured(home.services, sequence_folder)
        whole = home.end(seeds.queued_training(home.services, sequence, BUDGET_S))
        assert (whole.state, whole.attempt, home.rounds(whole)) == (JobState.SUCCEEDED, 1, [1, 2])
        return home.psnr_db(whole, sequence_folder)


def test_a_training_goes_on_to_as_good_a_model_whether_it_or_its_worker_is_killed(
    home: Home, job_id: str, sequence_folder: Path, undisturbed_db: float
):
    with home.worker() as first:
        home.job_when(job_id, lambda job: job.model_id is not None, "a first model")
        home.kill(child_of(job_id))
        again = home.job_when(job_id, partial(_goes_on, attempt=2), "going on after the crash")
        assert again.crashes == 1
        first.kill()
        with home.worker():
            killed = home.end(job_id)
    assert (killed.state, killed.attempt) == (JobState.SUCCEEDED, 3)
    assert home.rounds(killed) == [1, 2]  # nothing is finished twice
    assert home.psnr_db(killed, sequence_folder) > undisturbed_db - _CLOSE_DB


@pytest.mark.parametrize("home", ["ray"], indirect=True)
def test_a_node_captures_a_clip(home: Home):
    """As a worker's own children do (test_capturing)."""
    services, now = home.services, home.services.clock()
    person = PersonRow(id=new_id(), account="house", name="Ada", created_at=now)
    clip = services.objects.put(person.id, [seeds.real_frames()])
    with services.unit_of_work() as unit:
        unit.people.add(person)
        unit.flush()
        sequence = SequenceRow(
            id=new_id(),
            person_id=person.id,
            kind=SequenceKind.FRAMES,
            state=SequenceState.UPLOADED,
            created_at=now,
            source_name="frames.zip",
            source_sha256=clip.sha256,
        )
        unit.sequences.add(sequence)
        unit.flush()
        capture_id = enqueue(unit, JobKind.CAPTURE, sequence, {}, now).id
        unit.commit()
    with home.worker("capture"):
        captured = home.end(capture_id)
    assert captured.state is JobState.SUCCEEDED, captured.error
    with services.reading() as unit:
        assert unit.sequences.get(sequence.id).state is SequenceState.READY


def test_who_went_silent_is_fenced_off_from_whoever_took_over(home: Home, sequence_folder: Path):
    sequence = seeds.captured(home.services, sequence_folder)
    job_id = seeds.queued_training(home.services, sequence, budget_s=2.0)
    with home.worker():
        home.job_when(job_id, lambda job: job.progress > 0.0, "progress")
        late = child_of(job_id)
        os.kill(late, signal.SIGSTOP)
        try:
            home.job_when(job_id, lambda job: job.attempt == 2, "another attempt")
        finally:
            os.kill(late, signal.SIGCONT)
        until(lambda: not Path(f"/proc/{late}/cwd").exists(), "the end of the late process")
        done = home.end(job_id)
    assert (done.state, done.attempt, home.rounds(done)) == (JobState.SUCCEEDED, 2, [1])


def test_cancelling_reaches_what_runs_and_what_hangs_is_killed(home: Home, sequence_folder: Path):
    sequences = [seeds.captured(home.services, sequence_folder) for _ in range(2)]
    jobs = [seeds.queued_training(home.services, one, budget_s=60.0) for one in sequences]
    with home.worker():
        for job_id in jobs:
            home.job_when(job_id, lambda job: job.progress > 0.0, "progress")
        children = [child_of(job_id) for job_id in jobs]
        os.kill(children[1], signal.SIGSTOP)
        with home.services.unit_of_work() as unit:
            for job_id in jobs:
                cancel(unit, unit.jobs.get(job_id), home.services.clock())
            unit.commit()
        assert [home.end(job_id).state for job_id in jobs] == [JobState.CANCELLED] * 2
        for child in children:
            until(partial(_is_gone, child), "the end of a cancelled job's process")


def _goes_on(job: JobRow, attempt: int) -> bool:
    """Whether this attempt has learnt something."""
    return job.attempt == attempt and job.message.startswith("learning ")


def _is_gone(process_id: int) -> bool:
    return not Path(f"/proc/{process_id}/cwd").exists()
