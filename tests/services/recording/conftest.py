"""A gateway on a real port, as the control channel's tests have it, that keeps chunks sooner."""

import pytest

from tests.services.control.conftest import app as app
from tests.services.control.conftest import caller as caller
from tests.services.control.conftest import clock as clock
from tests.services.control.conftest import meeting as meeting
from tests.services.control.conftest import timed as timed


@pytest.fixture(autouse=True)
def shorter_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Most tests wait for a first chunk, while everything is drawn at thirty pictures a second."""
    monkeypatch.setattr("services.recording.recorder.CHUNK_MS", 2000)
