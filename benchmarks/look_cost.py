"""What live look costs its sender's page and the server, in processor time, and the line up.

Drawn: what a picture of 512 px a side takes longer where its performer has live colours. Coloured:
a picture's alignment and colours, on the thread that works them out beside the drawing. Decoded:
one frame of VP8 to picture, matte and code. All of them on one thread, in its own time, and that
of the process that decodes.
On the sender's page: what the browser takes with live look on and off, in turns, while it finds
landmarks. With it on the page finds fewer, so what finding takes is counted by the landmarks found.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from playwright.sync_api import Page

from benchmarks.browser import BUSY, metric, open_page, processor_seconds, running_demo
from benchmarks.landmark_finder import write_webcam_video
from benchmarks.local_look import PICTURES_PER_SECOND, Moment, on_line_bytes, sent_by
from benchmarks.meeting import AT_WORST_MS, prepare_meeting
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import clock_named
from benchmarks.serve import surface_model
from renderer.live_look.live_look import LiveLook
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene.camera import orbit_camera
from scene.motion import Pose
from services.live.look.decoder import LookDecoder
from services.live.look.packets import HEADER, Whose
from services.live.look.receiver import FRAME_SIZE, picture_of
from services.live.motion.motion_packet import LONGEST_MOTION_BYTES

SPLATS, SIZE = (10_000, 40_000), 512
MUST_DRAWN_MS, AIM_DRAWN_MS = (2.0, 5.0), (1.0, 3.0)
"""Added to a picture by a performer, by splats."""
MUST_DECODED_MS, AIM_DECODED_MS = 2.0, 1.0
MUST_UP_MBIT_S, AIM_UP_MBIT_S = 0.40, 0.25
MUST_CORES, AIM_CORES = 0.25, 0.12
"""Of the sender's browser, beside finding landmarks."""
_DRAWN, _WARM_UPS, _ROUNDS = 60, 5, 10
_PACKETS_PER_SECOND = 30
_TURNS, _TURN_S, _SETTLED_MS = 3, 12.0, 2000
_COUNTED = """
window.landmarks = 0;
const sendAny = RTCDataChannel.prototype.send;
RTCDataChannel.prototype.send = function (data) {
  if (this.label === "motion" && data instanceof ArrayBuffer) landmarks += 1;
  return sendAny.call(this, data);
};
"""


def run(writer: FigureWriter, clip: Path) -> None:
    """Measure and report; the sender's camera shows `clip`."""
    clock = clock_named("processor")
    models = {splats: surface_model(splats) for splats in SPLATS}
    sent = sent_by(models[SPLATS[0]], Whose(0, 1, 1))
    rows = [
        {
            "splats": splats,
            "drawn_ms": drawn_ms(model, clock.now),
            "coloured_ms": coloured_ms(model, sent, clock.now),
        }
        for splats, model in models.items()
    ]
    figures = {
        **clock.about(),
        "size": SIZE,
        "rows": rows,
        "decoded_ms": decoded_ms(sent, clock.now),
        "up_mbit_s": round(up_mbit_s(sent), 3),
        "sender": _sender(clip),
    }
    print(figures, flush=True)
    writer.write(figures)


def drawn_ms(model: SplatModel, now: Callable[[], float]) -> dict[str, float]:
    """A picture with trained colours, and what live ones add to it."""
    renderer, camera = SplatRenderer((model,)), orbit_camera((0, 0.9, 0), 2.4, 0.3, 0.0, SIZE, SIZE)
    pose = Pose.rest()
    moved = model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    change = np.random.default_rng(1).normal(0.0, 0.1, (len(model), 3)).astype(np.float32)
    seconds: dict[bool, list[float]] = {False: [], True: []}
    for count in range(_WARM_UPS + _DRAWN):
        for live in seconds:
            begun = now()
            renderer.render(camera, [moved], changes=[change if live else None])
            if count >= _WARM_UPS:
                seconds[live].append(now() - begun)
    alone, live = (1e3 * statistics.median(seconds[on]) for on in (False, True))
    return {"alone": round(alone, 2), "added": round(live - alone, 2)}


def coloured_ms(model: SplatModel, sent: list[Moment], now: Callable[[], float]) -> float:
    """To align a picture and take its colours, beside the drawing."""
    look, seconds = LiveLook(model), list[float]()
    for moment in sent:
        begun = now()
        look.see(moment.picture)
        look.change_at(moment.picture.pose.time_s)
        seconds.append(now() - begun)
    return round(1e3 * statistics.median(seconds[_WARM_UPS:]), 1)


def decoded_ms(sent: list[Moment], now: Callable[[], float]) -> float:
    """A frame of VP8 to picture, matte and code: here and in the process that decodes."""
    decoder, frames = LookDecoder(FRAME_SIZE), [one.frame[HEADER.size :] for one in sent]
    decoder.newest(frames[:1])
    begun, apart_s = now(), processor_seconds()
    for data in _ROUNDS * frames:
        rgb = decoder.newest([data])
        if rgb is None or picture_of(rgb) is None:
            raise RuntimeError("a frame must show a picture and a code; got one without")
    spent_s = now() - begun + processor_seconds() - apart_s
    decoder.close()
    return round(1e3 * spent_s / (_ROUNDS * len(frames)), 2)


def up_mbit_s(sent: list[Moment]) -> float:
    """Motion and pictures of one sender on the line."""
    pictures = sum(on_line_bytes(moment.frame) for moment in sent)
    motion = _PACKETS_PER_SECOND * on_line_bytes(bytes(LONGEST_MOTION_BYTES))
    return 8e-6 * (pictures * PICTURES_PER_SECOND / len(sent) + motion)


def _sender(clip: Path) -> dict[str, float]:
    """Cores that the browser takes for finding landmarks and for live look; landmarks a second."""
    with tempfile.TemporaryDirectory() as folder:
        camera = write_webcam_video(clip, Path(folder) / "webcam.mjpeg")
        meeting_id, token, _ = prepare_meeting(Path(folder), 1)
        with running_demo(Path(folder)) as address, open_page(webcam=camera) as page:
            page.set_default_timeout(AT_WORST_MS)
            page.add_init_script(_COUNTED)
            page.goto(f"{address}?meeting={meeting_id}&size=128#token={token}")
            page.get_by_test_id("start-join").click()
            page.get_by_test_id("motion-capture").click()
            page.wait_for_selector("[data-testid=self][data-tracking=tracking]")
            turns: dict[bool, list[tuple[float, float, float]]] = {False: [], True: []}
            for _ in range(_TURNS):
                for on in turns:
                    page.get_by_test_id("live-look").set_checked(on)
                    page.wait_for_timeout(_SETTLED_MS)
                    turns[on].append(_turn(page, address))
    without, live = (np.sum(turns[on], axis=0) for on in (False, True))
    a_landmark_s = without[0] / max(without[1], 1.0)
    return {
        "landmarks_per_second": round(float(without[1] / without[2]), 1),
        "with_live_look": round(float(live[1] / live[2]), 1),
        "cores_finding_landmarks": round(float(without[0] / without[2]), 2),
        "cores_for_live_look": round(float((live[0] - a_landmark_s * live[1]) / live[2]), 2),
    }


def _turn(page: Page, address: str) -> tuple[float, float, float]:
    """Processor seconds of the browser, landmarks, and seconds."""
    spent, found, begun = _browser_s(address), page.evaluate("landmarks"), time.perf_counter()
    page.wait_for_timeout(1e3 * _TURN_S)
    took = time.perf_counter() - begun
    return _browser_s(address) - spent, page.evaluate("landmarks") - found, took


def _browser_s(address: str) -> float:
    return processor_seconds() - metric(address, BUSY)
