"""A sealed meeting in real browsers: only who has the key of its link sees the others move."""

from __future__ import annotations

import base64
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page, ViewportSize, expect

from benchmarks.browser import open_page
from capture.detection.network_files import FACE_MODEL, HAND_MODEL, POSE_MODEL
from services.bootstrap import DEMO_MODEL, import_model
from services.live.sealed_packet import SEALED_BYTES
from services.meetings import create_meeting
from tests.e2e.serving import WATCH, Gateway, serving
from tests.e2e.test_control import beside, serious_faults
from tests.e2e.test_motion_capture import HEAR, SENT, Wire, outcome, webcam
from tests.landmark_models import landmark_model
from tests.services.jobs.waiting import until
from tests.services.live.test_driving_channels import motions
from tests.shared_data import shared_data
from tools.build_sealed_cases import code, seal

pytestmark = pytest.mark.e2e
MINUTES = 60_000
SIZE: ViewportSize = {"width": 640, "height": 480}
PACE_MS = 40.0
_KEY, _SALT = bytes(range(7, 23)), bytes(16)
KEY = base64.urlsafe_b64encode(_KEY).rstrip(b"=").decode()

# sealed packets, each at its own time
_DRIVE = """([performer, startMs, paceMs, sealed]) => {
  const packets = sealed.map((text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)));
  const newest = { ordered: false, maxRetransmits: 0, protocol: performer };
  const channel = viewPeer.createDataChannel("motion", newest);
  setInterval(() => {
    const packet = packets[Math.floor((Date.now() - startMs) / paceMs)];
    if (packet && channel.readyState === "open") channel.send(packet);
  }, paceMs);
}"""


@dataclass(frozen=True)
class Sealed:
    """A sealed meeting of Ada and Bo on a running server."""

    gateway: Gateway
    meeting_id: str
    performers: dict[str, str]

    @property
    def address(self) -> str:
        """The link without its key."""
        return f"{self.gateway.address}?meeting={self.meeting_id}&size=256"


@pytest.fixture(scope="module")
def meeting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sealed]:
    networks = {
        "pose_model": landmark_model(POSE_MODEL),
        "face_model": landmark_model(FACE_MODEL),
        "hand_model": landmark_model(HAND_MODEL),
    }
    with serving(tmp_path_factory.mktemp("sealed") / "data", **networks) as gateway:
        services = gateway.services
        models = [import_model(services, DEMO_MODEL, who.lower(), who) for who in ("Ada", "Bo")]
        with services.unit_of_work() as unit:
            made = create_meeting(services, unit, "ada", "Monday", models, sealed=True)
            performers = {one.name: one.id for one in made.performers}
            unit.commit()
        yield Sealed(gateway, made.id, performers)


@contextmanager
def pages_of(meeting: Sealed, film: Path | None, *names: str) -> Iterator[list[Page]]:
    """Everybody's page, each with an account of their own; the cameras show `film`."""
    with open_page(**SIZE, webcam=film) as first, ExitStack() as stack:
        others = [stack.enter_context(beside(first, viewport=SIZE)) for _ in names[1:]]
        pages = [first, *others]
        for page, name in zip(pages, names, strict=True):
            page.add_init_script(WATCH)
            token = meeting.gateway.token(name.lower())
            page.add_init_script(f"sessionStorage.setItem('metanerf.token', '{token}')")
        yield pages


def join(page: Page, address: str, name: str) -> None:
    page.goto(address)
    page.get_by_test_id("join-name").fill(name)
    page.get_by_test_id("start-join").click()
    expect(page.locator(".viewport > canvas.shown")).to_be_visible(timeout=MINUTES)


def seen(page: Page) -> np.ndarray:
    """The middle of the page's picture."""
    shot = page.screenshot(clip={"x": 200, "y": 120, "width": 240, "height": 200})
    decoded = cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    return decoded.astype(float)


def drive(page: Page, meeting: Sealed, name: str, seconds: float) -> None:
    """Have somebody wave, sealed by another library than a browser's."""
    start_ms = 1e3 * time.time()
    performer, waving, packets = meeting.performers[name], motions(), []
    for number in range(int(1e3 * seconds / PACE_MS)):
        motion = waving[number % len(waving)]
        motion = motion[:8] + struct.pack("<d", start_ms + number * PACE_MS) + motion[16:]
        sealed = seal(_KEY, _SALT, number + 1, motion, meeting.meeting_id, performer)
        packets.append(base64.b64encode(sealed).decode())
    page.evaluate(_DRIVE, [performer, start_ms, PACE_MS, packets])


def change(page: Page) -> float:
    """How far two pictures of a moment are apart, mean of 0 to 255."""
    first = seen(page)
    page.wait_for_timeout(400)
    return float(np.abs(seen(page) - first).mean())


def moves(page: Page) -> bool:
    return change(page) > 0.3


def test_only_whoever_has_the_key_sees_anybody_move(meeting: Sealed, tmp_path: Path):
    film = webcam(
        shared_data("real-monocular/webcam_upperbody_woman_asl.mp4"), tmp_path / "webcam.mjpeg"
    )
    passed, followed = (outcome("metanerf_motions_total", one) for one in ("sealed", "followed"))
    with pages_of(meeting, film, "Ada", "Bo", "Cy") as (ada, bo, cy):
        wires = [Wire(page) for page in (ada, bo, cy)]
        for page, name in ((ada, "Ada"), (bo, "Bo")):
            join(page, f"{meeting.address}#key={KEY}", name)
            assert "#" not in page.url
            shown = page.get_by_test_id("sealed-code")
            page.get_by_test_id("sealed").locator("summary").click()
            expect(shown).to_have_text(code(_KEY, meeting.meeting_id))
            page.get_by_test_id("sealed").locator("summary").click()
        cy.add_init_script(HEAR)
        join(cy, meeting.address, "Cy")
        problem = cy.get_by_test_id("sealed-problem")
        expect(problem).to_contain_text("This link lacks the meeting’s key")
        cy.get_by_test_id("sealed").locator("summary").click()  # it lies over the picture

        drive(bo, meeting, "Bo", 120.0)
        until(lambda: moves(ada), "Ada's page showing that Bo moves")
        ada.get_by_test_id("motion-capture").click()
        me = ada.get_by_test_id("self")
        expect(me).to_have_attribute("data-tracking", "tracking", timeout=2 * MINUTES)
        expect(me).to_contain_text("Only your movements leave this device, sealed.")
        expect(me.get_by_test_id("live-look")).to_have_count(0)
        until(lambda: moves(bo), "Bo's page showing that Ada moves")
        # both come to Cy's page too, which shows nobody move
        until(lambda: cy.evaluate("poses.length") > 20, "passing packets on to Cy")
        # once or twice the page draws more splats of them, or fewer
        assert float(np.median([change(cy) for _ in range(5)])) < 0.02

        sizes = ada.evaluate(SENT)
        assert {SEALED_BYTES} <= set(sizes["motion"]) <= {SEALED_BYTES, len("body")}
        cy.get_by_test_id("motion-capture").click()
        expect(cy.get_by_test_id("self")).to_contain_text("Your movements cannot be sealed")
        for wire in wires:
            said = [one.url + (one.post_data or "") for one in wire.requests]
            said += [one if isinstance(one, str) else one.decode() for one in wire.frames]
            assert said
            assert not [one for one in said if KEY in one]
        # the server passes all on, and follows nobody
        assert outcome("metanerf_motions_total", "sealed") > passed + 50
        assert outcome("metanerf_motions_total", "followed") == followed
        for page in (ada, cy):
            assert serious_faults(page) == []


def test_a_page_opens_a_sealed_meeting_and_its_link_brings_others_the_key(meeting: Sealed):
    with pages_of(meeting, None, "Ada", "Bo") as (ada, bo):
        ada.add_init_script("navigator.clipboard.writeText = async (text) => { copied = text; };")
        ada.goto(meeting.gateway.address)
        form = ada.get_by_test_id("seal")
        form.locator("summary").click()
        expect(ada.get_by_test_id("sealed-who").locator("option").first).to_have_text("Ada")
        assert serious_faults(ada) == []
        ada.get_by_test_id("sealed-open").click()
        expect(ada.locator(".viewport > canvas.shown")).to_be_visible(timeout=MINUTES)
        ada.get_by_test_id("sealed").locator("summary").click()
        expect(ada.get_by_test_id("sealed-code")).to_be_visible()
        shown = ada.get_by_test_id("sealed-code").inner_text()
        expect(ada.get_by_test_id("record")).to_be_hidden()
        expect(ada.get_by_test_id("render-mode")).to_be_hidden()
        ada.get_by_role("button", name="Copy invite link").click()
        link = ada.evaluate("copied")
        assert "#key=" in link
        assert "key" not in ada.url
        ada.reload()  # the tab keeps the key
        expect(ada.get_by_test_id("sealed-code")).to_have_text(shown, timeout=MINUTES)

        bo.goto(link)
        bo.get_by_test_id("start-join").click()
        expect(bo.get_by_test_id("sealed-code")).to_have_text(shown, timeout=MINUTES)
        expect(bo.get_by_test_id("sealed-problem")).to_be_hidden()
