"""A job's process: live meetings come before it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

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
