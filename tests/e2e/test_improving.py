"""Improving a model in a real browser: recorded while the meeting goes on, sent, and taken back."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page
from db.models import SequenceRow
from services.bootstrap import DEMO_MODEL, import_model
from services.meetings import create_meeting
from tests.e2e.serving import Gateway, serving
from tests.e2e.test_motion_capture import webcam
from tests.e2e.viewport import frames_shown
from tests.services.jobs.waiting import until
from tests.shared_data import shared_data

pytestmark = pytest.mark.e2e
MINUTE = 60_000


def enter(page: Page, gateway: Gateway) -> str:
    """Into a meeting in which a model of one's own stands; the person's id."""
    services = gateway.services
    ada = import_model(services, DEMO_MODEL, "ada", "Ada")
    with services.unit_of_work() as unit:
        meeting = create_meeting(services, unit, "ada", "Monday", [ada])
        unit.commit()
    page.goto(f"{gateway.address}?meeting={meeting.id}&size=128#token={gateway.token('ada')}")
    page.get_by_test_id("start-join").click()
    return ada.person_id


def films(gateway: Gateway, person_id: str) -> list[SequenceRow]:
    with gateway.services.reading() as unit:
        return unit.sequences.of_person(person_id)


def objects(gateway: Gateway, person_id: str) -> set[str]:
    return {info.sha256 for info in gateway.services.objects.list(person_id)}


def test_a_film_is_sent_and_taken_back_while_the_meeting_goes_on(tmp_path: Path):
    clip = shared_data("real-monocular/webcam_upperbody_woman_asl.mp4")
    camera = webcam(clip, tmp_path / "webcam.mjpeg")
    with serving(tmp_path / "data") as gateway, open_page(webcam=camera) as page:
        person_id = enter(page, gateway)
        before = objects(gateway, person_id)
        switch, panel = (
            page.get_by_role("button", name="Improve my model"),
            page.get_by_test_id("improve"),
        )
        expect(switch).to_have_attribute("aria-pressed", "false", timeout=MINUTE)
        expect(panel).to_be_hidden()
        switch.click()
        expect(panel).to_contain_text("sent to the server and deleted after training")
        expect(panel).to_have_attribute("data-kind", "filming", timeout=MINUTE)
        expect(switch).to_have_attribute("aria-pressed", "true")
        shown = frames_shown(page)
        expect(panel).to_contain_text("Detecting you in the clip", timeout=MINUTE)
        assert frames_shown(page) > shown
        (film,) = films(gateway, person_id)
        assert film.source_sha256 in objects(gateway, person_id)
        # nobody looks on any more
        assert page.evaluate("document.querySelector('.improve video') === null")
        switch.click()
        expect(panel).to_contain_text("The clip has been deleted", timeout=MINUTE)
        expect(switch).to_have_attribute("aria-pressed", "false")
        until(lambda: films(gateway, person_id) == [], "removing the film")
        until(lambda: objects(gateway, person_id) == before, "removing its bytes")
        assert page.evaluate("localStorage.getItem('metanerf.films')") is None
        panel.get_by_role("button", name="Close").press("Enter")
        expect(panel).to_be_hidden()
        expect(switch).to_be_focused()
