"""A job's process: live meetings come before it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from db.models import JobKind
from services.composition import build_services
from services.jobs.queue import STORE_AWAY
from services.settings import Settings
from tests.services import seeds
from tests.services.conftest import changed

_SHOW = """
import os
from pathlib import Path
from services.jobs.child import give_way
give_way(7)
print(os.nice(0), Path("/proc/self/autogroup").read_text().split()[-1])
"""


@pytest.mark.skipif(
    not Path("/proc/self/autogroup").exists(), reason="this system has no autogroups"
)
def test_a_job_gives_way_to_the_processes_of_other_sessions_too():
    shown = subprocess.run(
        [sys.executable, "-c", _SHOW],
        check=True,
        capture_output=True,
        text=True,
        start_new_session=True,  # as the worker starts it
    )
    assert shown.stdout.split() == [str(min(19, os.nice(0) + 7)), "7"]


def test_a_store_that_goes_away_is_no_crash(settings: Settings, sequence_folder: Path):
    services = build_services(settings)
    services.database.migrate()
    job_id = seeds.queued_training(services, seeds.captured(services, sequence_folder))
    with services.unit_of_work() as unit:
        job = unit.jobs.claim([JobKind.TRAIN], "a worker", services.clock())
        unit.commit()
    assert job is not None
    services.close()
    away = changed(settings, object_store_url="s3://test", s3_endpoint_url="http://127.0.0.1:1")
    child = subprocess.Popen(
        [sys.executable, "-m", "services.jobs.child", job_id, str(job.attempt)],
        env=away.child_environment(),
        stdin=subprocess.PIPE,
    )
    assert child.wait(120) == STORE_AWAY
