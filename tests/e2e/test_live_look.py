"""Live look in a real browser: what leaves, of which moment it is, and when it ends."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page
from capture.detection.network_files import FACE_MODEL, HAND_MODEL, POSE_MODEL
from services.bootstrap import DEMO_MODEL, import_model
from services.gateway import gateway_of
from services.live.look.picture import DroppedPictures, LookPicture, PoseRequest
from services.live.look.receiver import SILENCE_S
from services.meetings import create_meeting
from tests.e2e.serving import WATCH, Gateway, serving
from tests.e2e.test_motion_capture import webcam
from tests.landmark_models import landmark_model
from tests.services.jobs.waiting import until
from tests.shared_data import shared_data

pytestmark = pytest.mark.e2e
MINUTES = 60_000
_SOON_MS = 500.0 * SILENCE_S
"""Long before silence would tell."""
OUTGOING_VIDEO = """async () => {
  let bytes = 0;
  (await viewPeer.getStats()).forEach((one) => {
    if (one.type === "outbound-rtp" && one.kind === "video") bytes += one.bytesSent;
  });
  return bytes;
}"""
WATCH_KEYPOINTS = """
window.captured = [];
const sendAny = RTCDataChannel.prototype.send;
RTCDataChannel.prototype.send = function (data) {
  // text asks whose motion it is
  const packet = this.label === "motion" && data instanceof ArrayBuffer;
  if (packet) captured.push(new DataView(data).getFloat64(8, true));
  return sendAny.call(this, data);
};
const nowMs = () => performance.timeOrigin + performance.now();
document.addEventListener("change", () => (window.changedMs = nowMs()), true);
"""
"""`captured`: capture times of the landmarks sent; `changedMs`: when a switch was last used."""


WATCH_COLOURS = """
window.colours = [];
let handed = null;
const nowMs = () => performance.timeOrigin + performance.now();
const texImage = WebGL2RenderingContext.prototype.texImage2D;
WebGL2RenderingContext.prototype.texImage2D = function (...args) {
  if (args[2] === this.R32UI && args[3] === 256) handed = args[8].filter(Boolean).length;
  return texImage.apply(this, args);
};
const drawArrays = WebGL2RenderingContext.prototype.drawArrays;
WebGL2RenderingContext.prototype.drawArrays = function (...args) {
  if (handed !== null) colours.push([nowMs(), handed]);
  handed = null;
  return drawArrays.apply(this, args);
};
"""
"""`colours`: when the page drew after it handed changes to the card, and of how many splats."""


class Kept(DroppedPictures):
    """What the server shows, and when it stopped (s since 1970)."""

    def __init__(self) -> None:
        self.pictures: list[LookPicture] = []
        self.stopped_s: list[float] = []

    def receive(self, picture: LookPicture, request: PoseRequest | None = None) -> None:
        self.pictures.append(picture)

    def stop(self) -> None:
        self.stopped_s.append(time.time())


def networks() -> dict[str, Path]:
    """What finds landmarks."""
    return {
        "pose_model": landmark_model(POSE_MODEL),
        "face_model": landmark_model(FACE_MODEL),
        "hand_model": landmark_model(HAND_MODEL),
    }


def meeting_of(gateway: Gateway) -> str:
    """Where to come into a meeting with a model of one's own."""
    services = gateway.services
    ada = import_model(services, DEMO_MODEL, "ada", "Ada")
    with services.unit_of_work() as unit:
        meeting = create_meeting(services, unit, "ada", "Monday", [ada])
        unit.commit()
    return f"{gateway.address}?meeting={meeting.id}&size=128#token={gateway.token('ada')}"


def enter(page: Page, address: str) -> None:
    """Into a meeting in which one's own model moves by the webcam."""
    page.add_init_script(WATCH + WATCH_KEYPOINTS)
    page.goto(address)
    page.get_by_test_id("start-join").click()
    page.get_by_test_id("motion-capture").click()
    self = page.get_by_test_id("self")
    expect(self).to_have_attribute("data-tracking", "tracking", timeout=5 * MINUTES)


def test_a_cut_out_leaves_while_the_switch_is_on_and_not_a_moment_longer(tmp_path: Path):
    clip = shared_data("real-monocular/webcam_upperbody_woman_asl.mp4")
    camera = webcam(clip, tmp_path / "webcam.mjpeg")
    with serving(tmp_path / "data", **networks()) as gateway, open_page(webcam=camera) as page:
        kept = Kept()
        gateway_of(gateway.app).views.driving_channels.make_look_sink = lambda *_: kept
        enter(page, meeting_of(gateway))
        switch, preview = page.get_by_test_id("live-look"), page.get_by_test_id("live-look-preview")
        expect(switch).not_to_be_checked()
        expect(preview).to_be_hidden()
        page.wait_for_timeout(1000)
        assert page.evaluate(OUTGOING_VIDEO) == 0
        switch.click()
        expect(preview).to_be_visible()
        expect(page.get_by_test_id("self")).to_contain_text("This picture of you leaves")

        def came() -> bool:
            page.wait_for_timeout(200)
            return len(kept.pictures) >= 20

        until(came, "pictures")
        switch.click()
        until(lambda: bool(kept.stopped_s), "stopping")
        # long before silence would tell
        assert kept.stopped_s[0] - page.evaluate("changedMs") / 1e3 < 0.5 * SILENCE_S
        expect(preview).to_be_hidden()
        shown, sent = len(kept.pictures), page.evaluate(OUTGOING_VIDEO)
        page.wait_for_timeout(1500)
        assert len(kept.pictures) == shown
        assert page.evaluate(OUTGOING_VIDEO) == sent
        told = {int(one) % 65536 for one in page.evaluate("captured")}
    assert {one.captured_ms for one in kept.pictures} <= told
    last = kept.pictures[-1]
    outside = last.matte == 0
    assert 0.1 < outside.mean() < 0.9
    # the room is black, however the coder smears
    assert last.rgb[outside].mean() < 8.0
    assert last.rgb[last.matte > 250].mean() > 40.0
    x, y, side = last.window
    assert side >= 240
    assert -side < min(x, y)


def test_a_page_that_draws_shows_them_until_the_switch_is_off(tmp_path: Path):
    clip = shared_data("real-monocular/webcam_upperbody_woman_asl.mp4")
    camera = webcam(clip, tmp_path / "webcam.mjpeg")
    with serving(tmp_path / "data", **networks()) as gateway, open_page(webcam=camera) as page:
        address = meeting_of(gateway)
        enter(page, address)
        browser = page.context.browser
        assert browser is not None
        viewer = browser.new_page(viewport={"width": 512, "height": 512})
        viewer.add_init_script(WATCH_COLOURS)
        viewer.goto(address)
        viewer.get_by_test_id("start-join").click()
        viewer.get_by_test_id("render-mode").select_option("local")
        expect(viewer.locator(".viewport > canvas.shown")).to_be_visible(timeout=MINUTES)

        def drawn() -> list[tuple[float, int]]:
            return viewer.evaluate("colours")

        def changed() -> bool:
            viewer.wait_for_timeout(200)
            return any(splats > 0 for _, splats in drawn())

        switch, gone_ms = page.get_by_test_id("live-look"), list[float]()
        # a busy machine may be late now and then, or end it before, as no picture came for a second
        while len(gone_ms) < 5 and not any(0.0 < one < _SOON_MS for one in gone_ms):
            viewer.evaluate("colours = []")
            switch.click()
            until(changed, "colours", 240.0)
            switch.click()
            until(lambda: drawn()[-1][1] == 0, "the end")
            gone_ms.append(drawn()[-1][0] - page.evaluate("changedMs"))
            viewer.wait_for_timeout(1500)
            assert drawn()[-1][1] == 0
    assert any(0.0 < one < _SOON_MS for one in gone_ms), gone_ms
