"""What is older than the settings say is deleted with all that hangs on it, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import pytest

from db.models import AuditEventRow, JobState
from services.container import Services
from services.retention import Forgotten, forget_old
from tests.services.api.authorisation_world import World
from tests.services.api.conftest import world as world
from tests.services.api.conftest import world_folder as world_folder
from tests.services.api.conftest import world_services as world_services
from tests.services.conftest import changed


@pytest.fixture
def services(world_services: Services) -> Services:
    """By a clock that stands still, at which everything was made."""
    return world_services


def later(services: Services, days: float, **settings: float) -> Services:
    """The same after so many days, with other settings."""
    now = services.clock() + timedelta(days=days)
    return replace(services, settings=changed(services.settings, **settings), clock=lambda: now)


def end_recording(services: Services, world: World) -> None:
    with services.unit_of_work() as unit:
        recording = unit.recordings.get(world.ada.params["recording_id"])
        recording.ended_at = services.clock()
        unit.commit()


def test_nothing_is_forgotten_unless_it_is_wanted(services: Services, world: World):
    end_recording(services, world)
    assert forget_old(later(services, 300.0)) == Forgotten(0, 0, 0)


def test_recordings_go_with_their_videos_and_bytes(services: Services, world: World):
    end_recording(services, world)
    recording_id, person_id = world.ada.params["recording_id"], world.ada.params["person_id"]
    with services.reading() as unit:
        named = {one.sha256 for one in unit.recordings.chunks(recording_id)}
    assert forget_old(later(services, 6.0, keep_recordings_days=7.0)).recordings == 0
    assert named <= {one.sha256 for one in services.objects.list(person_id)}
    assert forget_old(later(services, 8.0, keep_recordings_days=7.0)).recordings == 1
    assert not named & {one.sha256 for one in services.objects.list(person_id)}
    with services.reading() as unit:
        left = [one.id for one in unit.recordings.of_account("guest-ada")]
        assert left == []
        assert unit.recordings.exports([recording_id]) == []
        # that of somebody else, which has no end, stays
        assert unit.recordings.get(world.cy.params["recording_id"])


def test_clips_go_but_for_those_that_a_job_works_on(services: Services, world: World):
    sequence_id, model_id = world.ada.params["sequence_id"], world.ada.params["model_id"]
    with services.unit_of_work() as unit:
        unit.jobs.get(world.ada.params["job_id"]).state = JobState.RUNNING
        unit.commit()
    assert forget_old(later(services, 29.0, keep_clips_days=30.0)).clips == 0
    # Ada's spare one, and both of Cy's
    assert forget_old(later(services, 31.0, keep_clips_days=30.0)).clips == 3
    with services.unit_of_work() as unit:
        assert [one.id for one in unit.sequences.of_person(world.ada.params["person_id"])] == [
            sequence_id
        ]
        unit.jobs.get(world.ada.params["job_id"]).state = JobState.FAILED
        unit.commit()
    assert forget_old(later(services, 31.0, keep_clips_days=30.0)).clips == 1
    with services.reading() as unit:
        assert unit.models.get(model_id).files
        deleted = [one for one in unit.audit.of_account("") if one.action == "sequence.deleted"]
    assert len(deleted) == 4


def test_events_are_kept_for_a_year(services: Services):
    with services.unit_of_work() as unit:
        unit.audit.add(
            AuditEventRow(at=services.clock(), account="house", action="person.erased", details={})
        )
        unit.commit()
    assert forget_old(later(services, 364.0)).events == 0
    assert forget_old(later(services, 366.0)).events == 1
