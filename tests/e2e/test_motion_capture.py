"""A browser with a webcam: it finds landmarks, its performer moves, and no picture leaves it."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
import uvicorn
from playwright.sync_api import Page, Request, WebSocket, expect
from prometheus_client import REGISTRY

from benchmarks.browser import open_page
from benchmarks.landmark_finder import write_webcam_video
from capture.detection.network_files import FACE_MODEL, HAND_MODEL, POSE_MODEL
from scene.expression import EXPRESSION_COUNT, EXPRESSION_NAMES
from services.app import create_app
from services.auth import GUEST
from services.bootstrap import DEMO_MODEL, import_model
from services.composition import build_services
from services.gateway import gateway_of
from services.live.motion.live_motion import LiveMotion
from services.live.motion.motion_packet import MOTION_BYTES
from services.live.packets import decode_pose, packets_of
from services.live.room import Room
from services.meetings import create_meeting
from services.settings import load_settings
from tests.capture.people import JOINT
from tests.e2e.test_control import beside
from tests.landmark_models import landmark_model
from tests.services.jobs.waiting import until
from tests.shared_data import shared_data

pytestmark = pytest.mark.e2e
MINUTES = 60_000
LARGEST_BODY = 64 * 1024
"""Of a request: an SDP offer is the largest."""
LARGEST_FRAME = 16 * 1024
"""Of a WebSocket."""
FIRST, LAST = 70, 250
"""Frames of the clip in which she signs twice."""
ARMS = [JOINT[f"{side}_{part}"] for side in ("left", "right") for part in ("shoulder", "elbow")]
LIDS = [EXPRESSION_NAMES.index(f"blink_{side}") for side in ("left", "right")]

WATCH = """
window.peers = []; window.sent = {};
const Peer = RTCPeerConnection;
RTCPeerConnection = class extends Peer { constructor(...all) { super(...all); peers.push(this); } };
const send = RTCDataChannel.prototype.send;
RTCDataChannel.prototype.send = function (data) {
  (sent[this.label] ??= new Set()).add(data.byteLength ?? data.length);
  return send.call(this, data);
};
"""
OUTGOING = """async () => {
  const kinds = [];
  for (const peer of peers) {
    for (const { track } of peer.getSenders()) if (track) kinds.push(track.kind);
    const report = await peer.getStats();
    // the place that live look has in the offer stays empty
    report.forEach(({ type, kind, bytesSent }) => {
      if (type === "outbound-rtp" && bytesSent > 0) kinds.push(kind);
    });
  }
  return kinds;
}"""
HEAR = """
window.poses = [];
const create = RTCPeerConnection.prototype.createDataChannel;
RTCPeerConnection.prototype.createDataChannel = function (label, ...how) {
  const channel = create.call(this, label, ...how);
  const keep = ({ data }) => poses.push([...new Uint8Array(data)]);
  if (label === "pose") channel.addEventListener("message", keep);
  return channel;
};
"""
"""Keeps what comes down as poses."""
SENT = "() => Object.fromEntries(Object.entries(sent).map(([label, sizes]) => [label, [...sizes]]))"


def webcam(source: Path, out: Path) -> Path:
    """Some frames of a clip as a camera of Chromium's."""
    return write_webcam_video(source, out, FIRST, LAST)


@contextmanager
def meeting_with_ada(data_dir: Path) -> Iterator[tuple[str, Callable[[], Room]]]:
    """A server with Ada in a meeting: the page's address, and what gives its room."""
    settings = load_settings(
        data_dir=data_dir,
        open_access=True,
        embedded_worker=False,
        pose_model=landmark_model(POSE_MODEL),
        face_model=landmark_model(FACE_MODEL),
        hand_model=landmark_model(HAND_MODEL),
    )
    services = build_services(settings)
    services.database.migrate()
    ada = import_model(services, DEMO_MODEL, GUEST, "Ada")
    with services.unit_of_work() as unit:
        meeting = create_meeting(services, unit, GUEST, "Monday", [ada])
        unit.commit()
    app = create_app(services)
    config = uvicorn.Config(app, port=0, log_level="warning", timeout_graceful_shutdown=3)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    until(lambda: server.started, "starting the server")
    port = server.servers[0].sockets[0].getsockname()[1]

    def look() -> Room:
        # Playwright runs a loop of its own in the test's thread
        with ThreadPoolExecutor(1) as beside:
            return beside.submit(asyncio.run, gateway_of(app).views.room(meeting.id)).result()

    try:
        yield f"http://127.0.0.1:{port}/?meeting={meeting.id}&size=128", look
    finally:
        server.should_exit = True
        thread.join(30.0)


class Wire:
    """Everything that a page sends."""

    def __init__(self, page: Page) -> None:
        self.requests: list[Request] = []
        self.frames: list[bytes | str] = []
        page.add_init_script(WATCH)
        page.on("request", lambda request: self.requests.append(request))
        page.on("websocket", self._listen)

    def _listen(self, socket: WebSocket) -> None:
        socket.on("framesent", lambda payload: self.frames.append(payload))

    def assert_no_picture(self, page: Page, address: str) -> None:
        """No body of a picture's size or type, no other server, no outgoing media."""
        home = urlsplit(address).netloc
        for request in self.requests:
            assert (
                request.url.startswith(("data:", "blob:")) or urlsplit(request.url).netloc == home
            )
            assert len(request.post_data_buffer or b"") <= LARGEST_BODY
            kind = request.headers.get("content-type", "")
            assert not kind.startswith(("image/", "video/", "multipart/", "application/octet"))
        assert all(len(frame) <= LARGEST_FRAME for frame in self.frames)
        assert "video" not in page.evaluate(OUTGOING)
        sizes = page.evaluate(SENT)
        # what moves, and the question whose motion it is
        assert {MOTION_BYTES} <= set(sizes["motion"]) <= {MOTION_BYTES, len("body")}
        assert "keypoints" not in sizes
        assert max(max(one) for one in sizes.values()) <= 1100
        # what the worker asks for is heard here too
        assert any(request.url.endswith("/v1/landmarks/model") for request in self.requests)


def joints(room: Room) -> np.ndarray:
    """Places of Ada's joints now, m."""
    (performer,) = room.scene_at(time.monotonic()).performers
    pose = performer.pose
    skeleton = performer.model.skeleton
    return skeleton.joint_transforms(pose.joint_angles, pose.root_translation)[:, :3, 3]


def outcome(name: str, of: str) -> float:
    """How many packets of a counter this became of."""
    return REGISTRY.get_sample_value(name, {"outcome": of}) or 0.0


def sees_somebody_move(page: Page, address: str) -> None:
    """Another page draws by itself, and Ada's arms move there as her own page last solved them."""
    page.add_init_script(HEAR)
    page.goto(address)
    page.get_by_test_id("start-join").click()
    page.get_by_test_id("render-mode").select_option("local", force=True)

    def moved() -> bool:
        page.wait_for_timeout(200)
        told = [packets_of(bytes(one)) for one in page.evaluate("poses")]
        poses = [decode_pose(packet) for packets in told for packet in packets]
        live = [pose.rotations[ARMS] for pose in poses if pose.landmarks_age_ms]
        return len(live) > 10 and bool(np.ptp(live, axis=0).max() > 0.1)

    until(moved, "seeing Ada move from another page")


def test_who_is_seen_by_their_webcam_moves_in_the_meeting_and_no_picture_leaves(tmp_path):
    clip = shared_data("real-monocular/webcam_upperbody_woman_asl.mp4")
    film = webcam(clip, tmp_path / "webcam.mjpeg")
    with meeting_with_ada(tmp_path / "data") as (address, look), open_page(webcam=film) as page:
        wire = Wire(page)
        solved = outcome("metanerf_keypoints_total", "solved")
        followed = outcome("metanerf_motions_total", "followed")
        page.goto(address)
        page.get_by_test_id("start-join").click()
        self = page.get_by_test_id("self")
        expect(self).to_be_hidden()
        page.get_by_test_id("motion-capture").click()
        expect(self).to_contain_text("Only your movements leave this device", timeout=MINUTES)
        expect(self).to_have_attribute("data-tracking", "tracking", timeout=2 * MINUTES)
        expect(self).to_contain_text("Your movements are shown in the meeting")
        room = look()
        until(lambda: list(room.live_motions.values()) != [], "driving Ada")
        (driven,) = room.live_motions.values()
        assert isinstance(driven, LiveMotion)
        until(lambda: driven.pose_at(time.monotonic()) is not None, "the first pose")
        shown = [joints(room)]

        def moved() -> bool:
            page.wait_for_timeout(100)
            shown.append(joints(room))
            wrists = np.array(shown)[:, [JOINT["left_wrist"], JOINT["right_wrist"]]]
            return bool(np.ptp(wrists, axis=0).max() > 0.15)

        until(moved, "moving as she signs")
        # her face is looked at in crops, by a worker of its own
        expressions: list[np.ndarray] = []

        def blinked() -> bool:
            page.wait_for_timeout(50)
            pose = driven.pose_at(time.monotonic())
            expressions.append(np.zeros(EXPRESSION_COUNT) if pose is None else pose.expression)
            return bool(np.ptp(expressions, axis=0)[LIDS].max() > 0.1)

        until(blinked, "blinking as she signs")
        # an upper body alone stands on its feet
        feet = np.array(shown)[:, [JOINT["left_ankle"], JOINT["right_ankle"]]]
        assert np.ptp(feet, axis=0).max() < 0.02
        wire.assert_no_picture(page, address)
        with beside(page) as other:
            sees_somebody_move(other, address)

        def went_on() -> bool:
            page.wait_for_timeout(100)
            return outcome("metanerf_motions_total", "followed") > followed + 50

        until(went_on, "going on to move by what her page solves")
        # her page solved it all
        assert outcome("metanerf_keypoints_total", "solved") == solved
        assert outcome("metanerf_motions_total", "malformed") == 0
        page.get_by_test_id("motion-capture").click()
        expect(self).to_be_hidden()
        until(lambda: room.live_motions == {}, "letting go of Ada")
        assert page.evaluate("document.querySelector('.self video') === null")
