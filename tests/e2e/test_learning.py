"""Learning from live look in a real browser: its switch and lamp, what is kept and what is not."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page
from db.models import JobState, Purpose, SequenceKind, SequenceRow
from renderer.model_files import save_model
from renderer.splats.model import SplatModel
from services.gateway import gateway_of
from services.live.look.keeping import Keeping
from services.live.look.picture import DroppedPictures, LookPicture, PoseRequest
from services.meetings import create_meeting
from tests.e2e.serving import Gateway, serving
from tests.e2e.test_live_look import enter, networks
from tests.e2e.test_motion_capture import webcam
from tests.renderer.live_look.people import person_in_checks, seen_from
from tests.services import seeds
from tests.services.jobs.teaching import run_next_training
from tests.services.jobs.waiting import until
from tests.shared_data import shared_data

pytestmark = pytest.mark.e2e
SECONDS = 1000


class Turned(DroppedPictures):
    """Has the server see somebody from beside, of whom the page sends pictures."""

    def __init__(self, model: SplatModel) -> None:
        self._keeping, self._model = Keeping(time.monotonic), model
        self._beside = seen_from(model, 120.0)

    @property
    def keeping(self) -> Keeping:
        return self._keeping

    def receive(self, picture: LookPicture, request: PoseRequest | None = None) -> None:
        if self._keeping.on:
            pose = replace(self._beside.pose, time_s=time.monotonic())
            self._keeping.look_at(self._model, self._beside, pose)


def meeting_of(gateway: Gateway, folder: Path) -> tuple[str, str]:
    """Where to come into a meeting with a model whose clip is stored; the id of its person."""
    services = gateway.services
    save_model(person_in_checks(), folder / "ada.safetensors")
    clip = seeds.film(folder / "clip")
    row = seeds.with_clip(services, folder / "ada.safetensors", clip, "ada")
    with services.unit_of_work() as unit:
        meeting = create_meeting(services, unit, "ada", "Monday", [unit.models.get(row.id)])
        unit.commit()
    channels = gateway_of(gateway.app).views.driving_channels
    channels.make_look_sink = lambda performer, _: Turned(performer.model)
    address = f"{gateway.address}?meeting={meeting.id}&size=128#token={gateway.token('ada')}"
    return address, row.person_id


def kept(gateway: Gateway, person_id: str) -> list[SequenceRow]:
    with gateway.services.reading() as unit:
        rows = unit.sequences.of_person(person_id)
        return [one for one in rows if one.kind is SequenceKind.LIVE]


def stands_as(gateway: Gateway, address: str) -> str:
    """The model of who is in the meeting of this address."""
    (meeting_id,) = parse_qs(urlsplit(address).query)["meeting"]
    with gateway.services.reading() as unit:
        (performer,) = unit.meetings.get(meeting_id).performers
        return performer.model_id


def shown_at_the_end(page: Page) -> None:
    """Learn for a while, then switch it off."""
    switch, sheet = page.get_by_test_id("learning"), page.get_by_test_id("kept-sheet")
    # what waits is not known before it is off: until something does, on again
    for _ in range(20):
        switch.click()
        expect(page.locator(".learning.on")).to_be_visible(timeout=20 * SECONDS)
        expect(page.get_by_test_id("learning-words")).to_contain_text("only if you say so")
        page.wait_for_timeout(1500)
        switch.click()
        expect(page.locator(".learning.on")).to_have_count(0)
        page.wait_for_timeout(500)
        if sheet.is_visible():
            return
    raise AssertionError("nothing was kept")


def test_what_waits_is_shown_at_the_end_and_kept_or_dropped_as_one_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("services.jobs.kept_frames.BUDGET_S", 1.0)
    clip = shared_data("real-monocular/webcam_upperbody_woman_asl.mp4")
    camera = webcam(clip, tmp_path / "webcam.mjpeg")
    with serving(tmp_path / "data", **networks()) as gateway, open_page(webcam=camera) as page:
        page.set_default_timeout(240 * SECONDS)  # a busy machine draws slowly
        address, person_id = meeting_of(gateway, tmp_path)
        enter(page, address)
        switch, sheet = page.get_by_test_id("learning"), page.get_by_test_id("kept-sheet")
        words = page.get_by_test_id("learning-words")
        expect(switch).not_to_be_checked()
        expect(page.get_by_test_id("live-look")).not_to_be_checked()
        with gateway.services.reading() as unit:
            assert Purpose.LEARNING not in unit.people.get(person_id).consent_purposes
        page.get_by_test_id("live-look").click()
        expect(page.locator(".learning.on")).to_have_count(0)
        shown_at_the_end(page)
        with gateway.services.reading() as unit:
            assert Purpose.LEARNING in unit.people.get(person_id).consent_purposes
        expect(words).to_contain_text("head from 120 degrees to their left")
        assert sheet.locator("img").count() >= 1
        assert sheet.locator("img").first.evaluate("one => one.naturalWidth") == 96
        page.get_by_test_id("kept-drop").click()
        expect(sheet).to_be_hidden()
        expect(words).to_contain_text("Dropped")
        assert kept(gateway, person_id) == []
        shown_at_the_end(page)
        page.get_by_test_id("kept-keep").click()
        expect(sheet).to_be_hidden()
        until(lambda: kept(gateway, person_id), "storing")
        (row,) = kept(gateway, person_id)
        assert row.frames is not None
        assert row.frames >= 1
        expect(words).to_contain_text("learns from them")
        job = run_next_training(gateway.services, tmp_path / "lesson")
        assert job.state is JobState.SUCCEEDED, job.message
        assert stands_as(gateway, address) == job.model_id
        expect(page.locator("[data-testid=self][data-tracking=tracking]")).to_be_visible()


def test_whoever_leaves_is_asked_first_and_a_page_that_goes_drops_them(tmp_path: Path):
    clip = shared_data("real-monocular/webcam_upperbody_woman_asl.mp4")
    camera = webcam(clip, tmp_path / "webcam.mjpeg")
    with serving(tmp_path / "data", **networks()) as gateway, open_page(webcam=camera) as page:
        page.set_default_timeout(240 * SECONDS)  # a busy machine draws slowly
        address, person_id = meeting_of(gateway, tmp_path)
        enter(page, address)
        page.get_by_test_id("live-look").click()
        sheet = page.get_by_test_id("kept-sheet")
        page.get_by_test_id("learning").click()
        expect(page.locator(".learning.on")).to_be_visible(timeout=20 * SECONDS)
        page.wait_for_timeout(6000)
        page.get_by_test_id("leave").click()
        expect(sheet).to_be_visible(timeout=20 * SECONDS)
        page.get_by_test_id("kept-keep").click()
        expect(page.get_by_test_id("start-join")).to_be_visible(timeout=20 * SECONDS)
        until(lambda: kept(gateway, person_id), "storing")
        before = len(kept(gateway, person_id))
        page.reload()
        enter(page, address)
        page.get_by_test_id("live-look").click()
        page.get_by_test_id("learning").click()
        expect(page.locator(".learning.on")).to_be_visible(timeout=20 * SECONDS)
        page.wait_for_timeout(4000)
        page.goto("about:blank")
        views = gateway_of(gateway.app).views
        until(lambda: len(views) == 0, "the end of the session")
        assert len(kept(gateway, person_id)) == before
