"""A clip that is uploaded over a line which breaks half-way: it arrives whole, nothing twice."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import ConsoleMessage, Page, Request, expect

from benchmarks.browser import open_page
from benchmarks.faults.cut_line import CutLine, cut_line
from db.models import SequenceRow
from tests.e2e.serving import Gateway, serving
from tests.services import seeds

pytestmark = pytest.mark.e2e
MINUTE = 60_000
HEAD_BYTES = 2000
"""Of a request, at most."""


@dataclass
class Visit:
    """A page that sends a clip over a line."""

    gateway: Gateway
    line: CutLine
    page: Page
    clip: Path
    requests: list[Request] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    @property
    def size(self) -> int:
        """Of the clip, bytes."""
        return self.clip.stat().st_size

    def send(self) -> None:
        """Choose the clip on the page, and begin."""
        self.page.get_by_test_id("enrol-file").set_input_files(self.clip)
        self.page.get_by_test_id("enrol-name").fill("Ada")
        self.page.get_by_test_id("enrol-submit").click()

    def cut_half_way(self) -> None:
        """Have the line break amid a piece, once half of the clip is through."""
        self.line.cut_at = self.line.carried_bytes + int(0.55 * self.size)

    def sequences(self) -> list[SequenceRow]:
        """Of everybody of the page's account."""
        with self.gateway.services.reading() as unit:
            people = unit.people.of_account("ada")
            return [row for one in people for row in unit.sequences.of_person(one.id)]


@pytest.fixture
def visit(tmp_path: Path) -> Iterator[Visit]:
    clip = tmp_path / "me.zip"
    clip.write_bytes(seeds.archive({f"{i:02d}.png": seeds.picture(i, size=256) for i in range(40)}))
    with (
        serving(tmp_path / "data") as gateway,
        cut_line(urlsplit(gateway.address).port or 0) as line,
        open_page() as page,
    ):
        made = Visit(gateway, line, page, clip)
        page.on("request", lambda request: made.requests.append(request))
        page.on("console", lambda message: _note(message, made.complaints))
        page.goto(f"{line.address}#token={gateway.token('ada')}")
        yield made


def _note(message: ConsoleMessage, complaints: list[str]) -> None:
    if message.type == "error" and "net::ERR" not in message.text:
        complaints.append(message.text)


def test_a_cut_upload_goes_on_by_itself_when_the_line_is_back(visit: Visit):
    page, line = visit.page, visit.line
    visit.cut_half_way()
    visit.send()
    expect(page.locator(".message")).to_contain_text("Interrupted, trying again", timeout=MINUTE)
    share = int(page.get_by_test_id("progress").get_attribute("aria-valuenow") or 0)
    assert 0 < share <= 55
    line.cut_at = None
    expect(page.get_by_role("heading")).to_have_text("Detecting you in the clip", timeout=MINUTE)
    arrived_whole(visit)


def test_after_a_reload_the_same_clip_is_gone_on_with(visit: Visit):
    page, line = visit.page, visit.line
    visit.cut_half_way()
    visit.send()
    expect(page.locator(".message")).to_contain_text("Interrupted, trying again", timeout=MINUTE)
    page.goto("about:blank")
    line.cut_at = None
    page.goto(line.address)
    visit.send()
    expect(page.get_by_role("heading")).to_have_text("Detecting you in the clip", timeout=MINUTE)
    arrived_whole(visit)
    kept = page.evaluate("Object.keys(localStorage).filter(key => key.includes('upload'))")
    assert kept == []


def arrived_whole(visit: Visit) -> None:
    """One sequence of the clip's own bytes, nothing sent twice, no complaint of the browser."""
    (sequence,) = visit.sequences()
    assert sequence.source_sha256 == hashlib.sha256(visit.clip.read_bytes()).hexdigest()
    pieces = [one for one in visit.requests if one.method == "PATCH"]
    offsets = [int(one.headers["upload-offset"]) for one in pieces]
    assert offsets == sorted(offsets)
    # not even what had come of the piece in which the line broke
    assert visit.line.carried_bytes < visit.size + HEAD_BYTES * len(visit.requests)
    assert visit.complaints == []
