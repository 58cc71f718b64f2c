"""Cost of a live view: from pose and camera to the picture, then into a browser.

Trained: one step of training splats (a frame drawn, compared, gone back through, all splats moved)
on every core, through a whole short schedule, since steps become cheaper as splats shrink.
Drawn: float RGBA by one renderer of all performers, p50, p95 and the share of frames over twice the
median, transforms made anew each frame, batch 1, no cache. Coded: the same and the room behind, to
a packet of video, processor time a step.
Served: a service and a headless Chromium's pages, each a viewer; see benchmarks/meeting.py.
"""

from __future__ import annotations

import resource
import tempfile
import time
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
import numpy as np

from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import late_share, milliseconds
from capture.studio.motions import turntable_motion
from capture.studio.performer import make_performer
from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, PARAMETERS, ROTATION
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.training.initialisation import sample_surface
from scene.arrays import Array
from scene.camera import Camera, orbit_camera

if TYPE_CHECKING:  # a browser's driver is loaded where pages are opened
    from benchmarks.meeting import DrivenMeeting

SIZES = (256, 512, 1024)
COUNTS = (5_000, 10_000, 20_000, 40_000, 50_000)
PERFORMERS = (1, 2, 4, 8)
VIEWERS = ((1, 512), (3, 512), (1, 1024))
"""How many watch, and how many pixels a side."""
_VIEWS, _WARM_UPS = 100, 10
_TRAINING_FRAMES, _STEPS = 60, 1500
_FRAMES_OF_ONE_SESSION = 10_000
_BESIDE_M = 0.8
_BITRATE = 2_500_000


def run(writer: FigureWriter) -> None:
    """Measure and report."""
    figures: dict[str, Any] = {"batch": 1, "threads": numba.get_num_threads()}
    figures["trained"] = _training_step()
    figures["drawn"] = [
        _drawing(count, performers, size)
        for count, performers, size in product(COUNTS, PERFORMERS, SIZES)
    ]
    figures["coded"] = [_encoding(*case) for case in product((512, 1024), (1, 4), (False, True))]
    figures["session"] = _long_session()
    figures["served"] = [_served(viewers, size) for viewers, size in VIEWERS]
    writer.write(figures)


def _training_step() -> dict[str, Any]:
    """Time of a step of the preset `splats` on a studio performer, exact poses, one camera."""
    from capture.storage import open_sequence
    from capture.studio import make_sequence
    from renderer.splats.settings import SplatSettings
    from renderer.splats.training.trainer import SplatTrainer

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip"
        make_sequence(path, frames=_TRAINING_FRAMES, size=SIZES[0])
        trainer = SplatTrainer(open_sequence(path), SplatSettings(), seed=0)
    trainer.warm_up()
    seconds, began = [], time.process_time()
    for step in range(_STEPS):
        started = time.perf_counter()
        trainer.step(step / _STEPS)
        seconds.append(time.perf_counter() - started)
    spent_ms = 1e3 * (time.process_time() - began) / _STEPS
    row = {
        "splats": len(trainer.splats.parameters),
        "frames": _TRAINING_FRAMES,
        "size": SIZES[0],
        "steps": _STEPS,
        **milliseconds(seconds),
        "cpu_ms": round(spent_ms, 2),
    }
    print(row, flush=True)
    return row


def _drawing(count: int, performers: int, size: int) -> dict[str, Any]:
    """One view after the other round `performers` who stand side by side."""
    people = StudioPerformers(count, performers)
    seconds = []
    for view in range(-_WARM_UPS, _VIEWS):
        started = time.perf_counter()
        people.draw(view, size)
        if view >= 0:
            seconds.append(time.perf_counter() - started)
    row = {
        "splats": count,
        "performers": performers,
        "size": size,
        **milliseconds(seconds),
        **late_share(seconds),
    }
    print(row, flush=True)
    return row


def _encoding(size: int, performers: int, moving: bool) -> dict[str, Any]:
    """Processor ms a picture: drawing into a frame, and each codec; by a still or moving viewer."""
    from services.live.rendering.drawing import FrameRenderer
    from services.live.room import MeetingPerformer, Room
    from services.live.streaming.encoding import Codec, PictureEncoder

    model = surface_model(10_000)
    cast = (MeetingPerformer.at_place(str(n), "", model, n) for n in range(performers))
    room, canvas = Room("", tuple(cast)), FrameRenderer()
    encoders, spent = {codec: PictureEncoder(codec) for codec in Codec}, dict.fromkeys(Codec, 0.0)
    painted, camera = 0.0, room.initial_camera(size, size)
    for tick in range(-_WARM_UPS, _VIEWS):
        if moving:
            camera = orbit_camera((0.0, 0.9, 0.0), 3.2, 0.01 * tick, 0.08, size, size)
        scene = room.scene_at(tick / 30.0)
        started = time.process_time()
        frame = canvas.render(scene, camera)
        painted += (time.process_time() - started) * (tick >= 0)
        for codec, encoder in encoders.items():
            started = time.process_time()
            encoder.encode(frame, tick + _WARM_UPS, _BITRATE, key=False)
            spent[codec] += (time.process_time() - started) * (tick >= 0)
    row = {
        "size": size,
        "performers": performers,
        "viewer": "moving" if moving else "still",
        "paint_ms": round(1e3 * painted / _VIEWS, 2),
        **{f"{codec.lower()}_ms": round(1e3 * s / _VIEWS, 2) for codec, s in spent.items()},
    }
    print(row, flush=True)
    return row


class StudioPerformers:
    """Performers side by side, and a camera that goes round them."""

    def __init__(self, count: int, performers: int) -> None:
        self.models = [surface_model(count)] * performers
        self._renderer = SplatRenderer(self.models)
        self._places = _BESIDE_M * (np.arange(performers) - 0.5 * (performers - 1))
        self._distance_m = 3.2 + 0.7 * _BESIDE_M * (performers - 1)

    def draw(self, view: int, size: int) -> Array:
        """The picture number `view`, by the CPU."""
        return self._renderer.render(self.camera(view, size), self.transforms(view))

    def camera(self, view: int, size: int) -> Camera:
        """From where the picture number `view` is seen."""
        return orbit_camera((0.0, 0.9, 0.0), self._distance_m, 0.05 * view, 0.05, size, size)

    def transforms(self, view: int) -> list[Array]:
        """Everybody's skinning transforms then."""
        made = []
        for number, (model, across) in enumerate(zip(self.models, self._places, strict=True)):
            pose = model.motion.pose((view + 7 * number) % len(model.motion))
            moved = pose.root_translation + np.array([across, 0.0, 0.0])
            made.append(model.skeleton.skinning_transforms(pose.joint_angles, moved))
        return made


def _long_session() -> dict[str, Any]:
    """Of many frames of one session: how much this process' peak memory grew, MiB, and how many
    frames came late."""
    people, peaks, seconds = StudioPerformers(10_000, 1), [], []
    for frames in (_FRAMES_OF_ONE_SESSION // 10, _FRAMES_OF_ONE_SESSION):
        for view in range(frames):
            started = time.perf_counter()
            people.draw(view, SIZES[0])
            seconds.append(time.perf_counter() - started)
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    grown_mib = round(peaks[1] - peaks[0], 1)
    return {
        "frames": _FRAMES_OF_ONE_SESSION,
        "grown_mib": grown_mib,
        **milliseconds(seconds),
        **late_share(seconds),
    }


def _served(viewers: int, size: int) -> dict[str, Any]:
    """What each of `viewers` pages shows of one meeting, each from its own place, and the cost.

    Reading capture times back from the pixels takes a good part of a browser's time: latency is
    that of pages which do, all else of pages as people have them.
    """
    from benchmarks.browser import metric
    from benchmarks.meeting import driven

    with driven(1) as meeting:
        row = {"size": size, **_shown(meeting, viewers, size, stamped=False)}
        row["render_p50_ms"] = round(metric(meeting.address, "metanerf_render_milliseconds"), 2)
        stamped = _shown(meeting, viewers, size, stamped=True)
    return row | {name: stamped[name] for name in stamped if name.startswith(("latency", "codes"))}


def _shown(meeting: DrivenMeeting, viewers: int, size: int, *, stamped: bool) -> dict[str, Any]:
    from benchmarks.browser import open_page
    from benchmarks.meeting import beside, look, watched

    with open_page(size, size) as first:
        look(first, meeting, size, stamped=stamped)
        others = [beside(first, meeting, size, stamped=stamped) for _ in range(viewers - 1)]
        return watched(meeting, [first, *others])


def surface_model(count: int) -> SplatModel:
    """Splats on a studio performer's body, as training begins with them."""
    rng, body = np.random.default_rng(0), make_performer(0).body
    points, _, weights, area = sample_surface(body, count, rng)
    parameters = np.zeros((count, PARAMETERS), np.float32)
    parameters[:, :3] = points
    parameters[:, LOG_SCALE : LOG_SCALE + 3] = np.log(0.6 * np.sqrt(area / count))
    parameters[:, ROTATION], parameters[:, OPACITY] = 1.0, 2.0
    parameters[:, COLOUR : COLOUR + 3] = rng.uniform(size=(count, 3))
    joints = np.argsort(-weights, axis=1)[:, :4].astype(np.uint8)
    top = np.take_along_axis(weights, joints.astype(int), axis=1).astype(np.float32)
    motion = turntable_motion(60, 30.0, 360.0)
    return SplatModel(
        parameters, joints, top, np.ones(count, bool), body.skeleton, motion, "benchmark"
    )
