"""Live look in a real browser: what leaves, of which moment it is, and when it ends."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page
from benchmarks.look_end import WATCH_COLOURS, WATCH_PICTURES, gone_after_ms
from capture.detection.network_files import FACE_MODEL, HAND_MODEL, POSE_MODEL
from renderer.performer_model import PerformerModel
from services.bootstrap import DEMO_MODEL, import_model
from services.gateway import gateway_of
from services.live.look.keeping import Keeping
from services.live.look.picture import (
    DroppedPictures,
    LookPicture,
    LookSink,
    PoseRequest,
    ShownLook,
)
from services.live.look.receiver import SILENCE_S
from services.live.motion.live_motion import LiveMotion
from services.live.packets import Kind
from services.live.room import MeetingPerformer
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


WATCH_END = """
window.endedMs = [];
const channelOf = RTCPeerConnection.prototype.createDataChannel;
RTCPeerConnection.prototype.createDataChannel = function (label, ...how) {
  const channel = channelOf.call(this, label, ...how);
  if (label === "look") channel.addEventListener("message", ({ data }) => {
    if (new Uint8Array(data)[1] === KIND) endedMs.push(performance.timeOrigin + performance.now());
  });
  return channel;
};
""".replace("KIND", str(int(Kind.LOOK_END)))
"""`endedMs`: when the page was told that somebody's live look is over, before it heeds it."""


class Kept(DroppedPictures):
    """What the server shows, and when it stopped (s since 1970)."""

    def __init__(self) -> None:
        self.pictures: list[LookPicture] = []
        self.stopped_s: list[float] = []

    def receive(self, picture: LookPicture, request: PoseRequest | None = None) -> None:
        self.pictures.append(picture)

    def stop(self) -> None:
        self.stopped_s.append(time.time())


class Drawn(LookSink):
    """Shows somebody as `sink` does, and notes when live colours were drawn, and when they ended
    (s since 1970)."""

    def __init__(self, sink: LookSink) -> None:
        self._sink = sink
        self.begun_s: list[tuple[float, bool]] = []
        """When each picture was begun, and whether in live colours."""
        self.stopped_s: list[float] = []

    @property
    def keeping(self) -> Keeping | None:
        return self._sink.keeping

    def receive(self, picture: LookPicture, request: PoseRequest | None = None) -> None:
        self._sink.receive(picture, request)

    def stop(self) -> None:
        self._sink.stop()
        self.stopped_s.append(time.time())

    def shown_of(self, model: PerformerModel) -> ShownLook | None:
        begun_s, shown = time.time(), self._sink.shown_of(model)
        self.begun_s.append((begun_s, shown is not None))
        return shown

    @property
    def live(self) -> bool:
        """Whether the newest picture is in live colours."""
        return self.begun_s[-1][1] if self.begun_s else False


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


def viewer_of(page: Page, address: str) -> Page:
    """Somebody else in the meeting, in the same browser."""
    browser = page.context.browser
    assert browser is not None
    viewer = browser.new_page(viewport={"width": 512, "height": 512})
    viewer.add_init_script(WATCH_COLOURS + WATCH_END)
    viewer.goto(address)
    viewer.get_by_test_id("start-join").click()
    return viewer


def test_a_page_that_draws_shows_them_until_the_switch_is_off(tmp_path: Path):
    clip = shared_data("real-monocular/webcam_upperbody_woman_asl.mp4")
    camera = webcam(clip, tmp_path / "webcam.mjpeg")
    with serving(tmp_path / "data", **networks()) as gateway, open_page(webcam=camera) as page:
        address = meeting_of(gateway)
        enter(page, address)
        viewer = viewer_of(page, address)
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
            viewer.evaluate("colours = []; endedMs = []")
            switch.click()
            until(changed, "colours", 240.0)
            switch.click()
            until(lambda: drawn()[-1][1] == 0, "the end")
            gone_ms.append(drawn()[-1][0] - page.evaluate("changedMs"))
            viewer.wait_for_timeout(1500)
            assert drawn()[-1][1] == 0
            told_ms = viewer.evaluate("endedMs.at(-1)")
            after = [splats for drawn_ms, splats in drawn() if drawn_ms > told_ms]
            assert not any(after), "no picture is in live colours once the page was told"
    assert any(0.0 < one < _SOON_MS for one in gone_ms), gone_ms


def test_where_the_server_draws_no_picture_after_the_switch_is_in_live_colours(tmp_path: Path):
    clip = shared_data("real-monocular/webcam_upperbody_woman_asl.mp4")
    camera = webcam(clip, tmp_path / "webcam.mjpeg")
    with serving(tmp_path / "data", **networks()) as gateway, open_page(webcam=camera) as page:
        channels = gateway_of(gateway.app).views.driving_channels
        show, sinks = channels.make_look_sink, list[Drawn]()

        def noted(performer: MeetingPerformer, motion: LiveMotion) -> LookSink:
            sinks.append(Drawn(show(performer, motion)))
            return sinks[-1]

        channels.make_look_sink = noted
        address = meeting_of(gateway)
        enter(page, address)
        viewer = viewer_of(page, address)
        viewer.get_by_test_id("render-mode").select_option("server")
        expect(viewer.get_by_test_id("live-video")).to_be_visible(timeout=MINUTES)
        until(lambda: bool(sinks) and bool(sinks[-1].begun_s), "drawing")
        drawn, switch = sinks[-1], page.get_by_test_id("live-look")
        viewer.evaluate(WATCH_PICTURES)
        told_ms: list[float | None] = []
        # signing hands may hide how the colours differ, and a busy machine shows few pictures
        while len(told_ms) < 5 and not any(told_ms):
            switch.click()
            until(lambda: drawn.live, "live colours", 240.0)
            viewer.evaluate("shown = []")
            viewer.wait_for_timeout(3000)
            times_stopped = len(drawn.stopped_s)
            switch.click()
            viewer.wait_for_timeout(4000)
            stopped_s = drawn.stopped_s[times_stopped]
            after = [live for begun_s, live in list(drawn.begun_s) if begun_s > stopped_s]
            assert after, "it draws on"
            assert not any(after), "no picture is in live colours after the end"
            told_ms.append(gone_after_ms(viewer.evaluate("shown"), page.evaluate("changedMs")))
        assert any(told_ms), "the page shows trained colours"
