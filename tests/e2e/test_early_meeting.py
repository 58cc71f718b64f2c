"""Enrolment in a real browser: met by a first likeness, which the model replaces in the meeting."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page
from capture.detection.network_files import POSE_MODEL
from db.models import JobKind, JobRow
from tests.e2e.serving import Gateway, serving
from tests.e2e.viewport import frames_shown
from tests.landmark_models import landmark_model
from tests.services import seeds
from tests.services.jobs.waiting import until

pytestmark = pytest.mark.e2e
MINUTES = 120_000
GOES_ON = re.compile("Detecting you in the clip|Training your model")
"""What a quick machine shows by then."""


def _jobs(gateway: Gateway) -> dict[JobKind, JobRow]:
    """Of the only clip."""
    with gateway.services.reading() as unit:
        (person,) = unit.people.of_account("ada")
        (sequence,) = unit.sequences.of_person(person.id)
        return {job.kind: job for job in unit.jobs.of_sequence(sequence.id)}


def _standing(gateway: Gateway) -> str | None:
    """The model that stands in the page's meeting."""
    with gateway.services.reading() as unit:
        (person,) = unit.people.of_account("ada")
        (meeting_id,) = unit.meetings.where_performs(person.id)
        (performer,) = unit.meetings.get(meeting_id).performers
    return performer.model_id


def _enrol(page: Page, clip: Path) -> None:
    page.get_by_test_id("enrol-file").set_input_files(clip)
    page.get_by_test_id("enrol-name").fill("Ada")
    page.get_by_test_id("enrol-submit").click()


def test_a_meeting_begins_by_a_first_likeness_and_sees_the_model_when_it_is_made(tmp_path: Path):
    clip = tmp_path / "me.zip"
    clip.write_bytes(seeds.real_frames(24))
    options = {"embedded_worker": True, "pose_model": landmark_model(POSE_MODEL)}
    with serving(tmp_path / "data", **options) as gateway, open_page() as page:
        page.goto(f"{gateway.address}#token={gateway.token('ada')}")
        _enrol(page, clip)
        meet, heading = page.get_by_test_id("meet"), page.get_by_role("heading", level=1)
        expect(meet).to_be_visible(timeout=MINUTES)
        expect(heading).to_have_text(GOES_ON)
        expect(page.locator(".message")).to_contain_text("This is a first likeness")
        expect(page.locator(".message")).not_to_contain_text("likeness is ready")
        expect(page.get_by_test_id("preview")).to_be_visible()
        likeness_id = _jobs(gateway)[JobKind.TRAIN].model_id
        meet.click()
        until(lambda: frames_shown(page) > 0, "a picture of the first likeness")
        assert _standing(gateway) == likeness_id
        # the page that asked for the training has left; the server goes on by itself
        until(lambda: _standing(gateway) != likeness_id, "the first round")
        training = _jobs(gateway)[JobKind.TRAIN]
        assert _standing(gateway) == training.model_id
        shown = frames_shown(page)
        until(lambda: frames_shown(page) > shown, "a picture of the model")
