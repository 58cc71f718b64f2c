"""A Ray cluster in bad weather: no head yet, no room, a lost node. Jobs wait, and then are done.

A training whose clip is nowhere is a job as short as any: it ends as soon as its process looks.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest

from db.models import JobKind, JobRow, JobState, SequenceState
from services.composition import build_services
from services.container import Services
from services.jobs.queue import enqueue
from services.settings import Settings
from tests.services import seeds
from tests.services.conftest import changed
from tests.services.jobs.homes import RayCluster, deployed, working
from tests.services.jobs.waiting import child_of, until

pytestmark = pytest.mark.server
_SEVERAL_LOOKS = timedelta(seconds=1.5)
"""Of the dispatcher, which looks for room twice a second."""
_BACK = "jobs are run again"


@pytest.fixture
def settings(
    tmp_path_factory: pytest.TempPathFactory, s3_endpoint: str, redis_url: str
) -> Iterator[Settings]:
    folder = tmp_path_factory.mktemp("weather")
    too_much = {"capture_resources": '{"num_cpus": 64}'}
    with deployed(folder, redis_url, s3_endpoint, **too_much) as made:
        yield made


@pytest.fixture
def services(settings: Settings) -> Iterator[Services]:
    made = build_services(settings)
    made.database.migrate()
    yield made
    made.close()


@pytest.fixture
def cluster(settings: Settings, tmp_path: Path) -> Iterator[RayCluster]:
    """Without a head yet."""
    made = RayCluster(settings, tmp_path)
    yield made
    made.close()


def queued(services: Services, kind: JobKind) -> str:
    clip = seeds.uploaded(services, SequenceState.READY)
    with services.unit_of_work() as unit:
        params = {"preset": "splats", "budget_s": 1.0, "seed": 0}
        job = enqueue(unit, kind, clip, params, services.clock())
        unit.commit()
    return job.id


def read(services: Services, job_id: str) -> JobRow:
    with services.reading() as unit:
        return unit.jobs.get(job_id)


def waits(services: Services, job_id: str, attempts: int = 0) -> bool:
    job = read(services, job_id)
    return (job.state, job.attempt) == (JobState.QUEUED, attempts)


def look_several_times(services: Services, job_id: str) -> None:
    """Have the dispatcher, which counts for a silent job as it looks, look for room again."""
    began = read(services, job_id).heartbeat_at
    assert began is not None

    def renewed() -> bool:
        beat = read(services, job_id).heartbeat_at
        return beat is not None and beat - began > _SEVERAL_LOOKS

    until(renewed, "signs of life")


def test_jobs_wait_for_a_head_and_for_room_and_outlive_a_node(
    settings: Settings, services: Services, cluster: RayCluster
):
    first, second = (queued(services, JobKind.TRAIN) for _ in range(2))
    too_large = queued(services, JobKind.CAPTURE)
    by_ray = changed(settings, ray_address=cluster.address)
    with working(by_ray, "ray", "train", "capture") as dispatcher:
        away = f"jobs wait: the head of the Ray cluster must answer at {cluster.address}"
        until(lambda: away in dispatcher.told(), "a word about the head")
        cluster.start_head()
        until(lambda: _BACK in dispatcher.told(), "a word about its return")
        until(cluster.asked_for, "a call for nodes")
        assert all(waits(services, one) for one in (first, second, too_large))
        assert " 64" not in dispatcher.told()  # a cluster without nodes may get a larger one

        cluster.add_node(cpus=1)
        os.kill(child_of(first), signal.SIGSTOP)
        look_several_times(services, first)
        assert waits(services, second)

        cluster.lose_nodes()
        until(lambda: waits(services, first, attempts=1), "the job's return to the queue")
        assert "its node is gone" in read(services, first).message

        cluster.add_node(cpus=1)
        for job_id in (first, second):
            until(lambda job_id=job_id: read(services, job_id).state.final, "the end")
        assert waits(services, too_large)
        told = dispatcher.told()
    ends = [read(services, one) for one in (first, second)]
    assert [(job.attempt, job.crashes) for job in ends] == [(2, 0), (1, 0)]
    for job in ends:
        assert job.error is not None
        assert job.error["type"] == "urn:metanerf:clip-gone"
    assert told.count(away) == told.count(_BACK) == 1
    assert told.count("a node must have what a capture takes") == 1
    assert "correct METANERF_CAPTURE_RESOURCES" in told
