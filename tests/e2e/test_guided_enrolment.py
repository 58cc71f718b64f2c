"""The page guides somebody through enrolment: its webcam shows a lifelike performer doing it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page
from capture.detection.network_files import POSE_MODEL
from capture.sources.pieces import read_pieces, unpacked_videos
from db.models import SequenceRow
from db.objects import fetch
from tests.e2e.guided_clip import SIZE, write_guided_clip
from tests.e2e.serving import Gateway, serving
from tests.e2e.test_control import serious_faults
from tests.landmark_models import landmark_model
from tests.shared_data import shared_data

pytestmark = pytest.mark.e2e
MINUTES = 60_000
STEPS = ("face", "turn_left", "turn_right", "step_back", "arms", "around", "hands")
FAILURES = {
    "face": "Look straight|Come closer",
    "turn_left": "Turn farther to the left",
    "turn_right": "That is your left|Turn farther to the right",
    "step_back": "Move back",
    "arms": "Move your left arm|Move your right arm",
    "hands": "Hold up your",
}
"""What a step says while the film shows something else."""
WATCH = """
window.told = JSON.parse(sessionStorage.getItem("told") ?? "[]");
new MutationObserver(() => {
  const guide = document.querySelector("[data-testid=guide]");
  const words = document.querySelector("[data-testid=guide-words]")?.textContent;
  const line = guide && words ? `${guide.dataset.step}: ${words}` : null;
  if (!line || told.includes(line)) return;
  told.push(line);
  sessionStorage.setItem("told", JSON.stringify(told));
}).observe(document, { subtree: true, childList: true, characterData: true, attributes: true });
"""
IS_SKIPPED = """(step) => new Promise((resolve) => {
  const opening = indexedDB.open("metanerf", 1);
  opening.onsuccess = () => {
    const all = opening.result.transaction("guides").objectStore("guides").getAll();
    const isSkipped = ({ state }) => state.outcomes[step] === "skipped";
    all.onsuccess = () => resolve(all.result.some(isSkipped));
  };
})"""
"""Whether a reload would find a step skipped: the page puts it away beside its work."""
KEPT = """async () => new Promise((resolve) => {
  const opening = indexedDB.open("metanerf", 1);
  opening.onsuccess = () => {
    const all = opening.result.transaction("guides").objectStore("guides").count();
    all.onsuccess = () => resolve(all.result);
  };
})"""


def _passes(page: Page, step: str) -> None:
    done = page.get_by_test_id(f"step-{step}")
    expect(done).to_have_attribute("data-status", "passed", timeout=4 * MINUTES)


def _is_wrong_and_skipped(page: Page, step: str) -> None:
    """Go to a step that is not what the webcam shows."""
    page.get_by_test_id(f"step-{step}").click()
    is_told = f"() => told.some((line) => /^{step}: ({FAILURES[step]})/.test(line))"
    page.wait_for_function(is_told, timeout=MINUTES)
    page.get_by_test_id("guide-skip").click()
    skipped = page.get_by_test_id(f"step-{step}")
    expect(skipped).to_have_attribute("data-status", "skipped")
    page.wait_for_function(IS_SKIPPED, arg=step)


def _start(page: Page) -> None:
    page.get_by_test_id("guide-start").click(timeout=MINUTES)


def _sequence(gateway: Gateway) -> SequenceRow:
    with gateway.services.reading() as unit:
        (person,) = unit.people.of_account("ada")
        (row,) = unit.sequences.of_person(person.id)
        return row


def test_each_step_is_checked_live_and_a_reload_costs_one_step_at_most(tmp_path: Path):
    film = write_guided_clip(tmp_path / "webcam.mjpeg", shared_data("human-assets"))
    with (
        serving(tmp_path / "data", pose_model=landmark_model(POSE_MODEL)) as gateway,
        open_page(1400, 850, webcam=film) as page,
    ):
        page.add_init_script(WATCH)
        page.goto(f"{gateway.address}#token={gateway.token('ada')}")
        page.get_by_role("button", name="Camera", exact=True).click()
        _start(page)
        for step in ("face", "turn_left"):
            _passes(page, step)
        assert serious_faults(page) == []
        _is_wrong_and_skipped(page, "face")
        page.reload()
        page.set_viewport_size({"width": 390, "height": 800})
        expect(page.get_by_test_id("guide-instruction")).to_have_text(
            "1 of 7 steps are recorded", timeout=MINUTES
        )
        expect(page.get_by_test_id("step-face")).to_have_attribute("data-status", "skipped")
        assert serious_faults(page) == []
        _start(page)
        for step in ("turn_right", "step_back", "arms", "around", "hands"):
            _passes(page, step)
        expect(page.get_by_test_id("guide-instruction")).to_have_text("Your clip is ready")
        page.get_by_test_id("step-face").click()
        _passes(page, "face")
        expect(page.get_by_test_id("guide-hint")).to_have_text("Every side has been seen.")
        told = page.evaluate("told")
        for step, words in FAILURES.items():
            assert any(re.match(f"{step}: ({words})", line) for line in told), (step, told)
        for words in ("Nobody is in the picture", "Too dark"):
            assert any(words in line for line in told), (words, told)
        page.get_by_test_id("enrol-name").fill("Ada")
        page.get_by_test_id("enrol-submit").click()
        heading = page.get_by_role("heading", level=1)
        expect(heading).to_have_text("Detecting you in the clip", timeout=MINUTES)
        page.wait_for_function(f"() => ({KEPT})().then((kept) => kept === 0)")
        _is_whole(gateway, tmp_path)


def _is_whole(gateway: Gateway, folder: Path) -> None:
    """One recording of each step arrived, and capture can read them as one clip."""
    row = _sequence(gateway)
    source = folder / "source.zip"
    fetch(gateway.services.objects, row.person_id, row.source_sha256, source)
    with unpacked_videos(source) as pieces:
        steps = [piece.stem.split("-")[-1] for piece in pieces]
    assert steps == list(STEPS)
    clip = read_pieces(source)
    assert clip.source_size == SIZE
    assert clip.times_s[-1] > 15.0
