"""What live look costs the server, in processor time, and the line up.

Drawn: what a picture of 512 px a side takes longer where its performer has live colours. Coloured:
a picture's alignment and colours, on the thread that works them out beside the drawing. Decoded:
one frame of VP8 to picture, matte and code. All of them on one thread, in its own time, and that
of the process that decodes. Started: that process, which each sender has one of, from nothing to
its first picture.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from benchmarks.browser import processor_seconds
from benchmarks.local_look import PICTURES_PER_SECOND, Moment, on_line_bytes, sent_by
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import clock_named
from benchmarks.serve import surface_model
from renderer.live_look.live_look import LiveLook
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene.camera import orbit_camera
from scene.live_appearance import LaidPicture, LiveAppearance
from scene.motion import Pose
from services.live.look.decoder import LookDecoder
from services.live.look.packets import HEADER, Whose
from services.live.look.receiver import FRAME_SIZE, PICTURE_PX, picture_of
from services.live.motion.motion_packet import LONGEST_MOTION_BYTES

SPLATS, SIZE = (10_000, 40_000), 512
MUST_DRAWN_MS, AIM_DRAWN_MS = (2.0, 5.0), (1.0, 3.0)
"""Added to a picture by a performer, by splats."""
MUST_DECODED_MS, AIM_DECODED_MS = 2.0, 1.0
MUST_UP_MBIT_S, AIM_UP_MBIT_S = 0.40, 0.25
_DRAWN, _WARM_UPS, _ROUNDS, _STARTS = 60, 5, 10, 5
_PACKETS_PER_SECOND = 30


def run(writer: FigureWriter) -> None:
    """Measure and report."""
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
        "decoder_start": decoder_start(sent),
        "up_mbit_s": round(up_mbit_s(sent), 3),
    }
    print(figures, flush=True)
    writer.write(figures)


def drawn_ms(model: SplatModel, now: Callable[[], float]) -> dict[str, float]:
    """A picture in trained colours, and what live ones and a picture laid on add to it."""
    renderer, camera = SplatRenderer((model,)), orbit_camera((0, 0.9, 0), 2.4, 0.3, 0.0, SIZE, SIZE)
    pose = Pose.rest()
    moved = model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    rng = np.random.default_rng(1)
    change = rng.normal(0.0, 0.1, (len(model), 3)).astype(np.float32)
    detail = rng.normal(1.0, 0.1, (PICTURE_PX, PICTURE_PX, 3)).astype(np.float32)
    shares = rng.random((len(model), 1), np.float32)
    places = np.concatenate([PICTURE_PX * shares * rng.random((len(model), 2)), shares], axis=1)
    laid = LaidPicture(detail, places.astype(np.float32), camera.position, 1.1 * PICTURE_PX)
    appearance = LiveAppearance(change, laid)
    seconds: dict[bool, list[float]] = {False: [], True: []}
    for count in range(_WARM_UPS + _DRAWN):
        for live in seconds:
            begun = now()
            renderer.render(camera, [moved], appearances=[appearance if live else None])
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


def decoder_start(sent: list[Moment]) -> dict[str, float]:
    """From nothing to the first picture: ms on the wall and of a processor, medians."""
    key_frame, took, spent = sent[0].frame[HEADER.size :], list[float](), list[float]()
    for _ in range(_STARTS):
        decoder, begun, apart_s = LookDecoder(FRAME_SIZE), time.perf_counter(), processor_seconds()
        decoder.newest([key_frame])
        took.append(time.perf_counter() - begun)
        spent.append(processor_seconds() - apart_s)
        decoder.close()
    return {
        "ms": round(1e3 * statistics.median(took)),
        "processor_ms": round(1e3 * statistics.median(spent)),
    }


def up_mbit_s(sent: list[Moment]) -> float:
    """Motion and pictures of one sender on the line."""
    pictures = sum(on_line_bytes(moment.frame) for moment in sent)
    motion = _PACKETS_PER_SECOND * on_line_bytes(bytes(LONGEST_MOTION_BYTES))
    return 8e-6 * (pictures * PICTURES_PER_SECOND / len(sent) + motion)
