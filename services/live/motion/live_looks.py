"""Live look on the server: the newest picture of each performer colours their splats.

A picture waits for a thread that works out what it changes; of each performer only the newest
waits. Nothing is worked out for performers whom the server does not draw. What is shown belongs to
the moment of the picture, so a performer's motion is shown as much later. Pages that draw by
themselves find the colours themselves, and take from here the pose that is aligned with a picture.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
from prometheus_client import Histogram

from renderer.live_look.picture import WebcamPicture
from renderer.performer_model import PerformerModel
from renderer.splats.model import SplatModel
from scene.camera import Camera
from scene.motion import Pose
from services.live.look.keeping import Keeping
from services.live.look.picture import (
    AlignedPose,
    LookPicture,
    LookSink,
    PoseRequest,
    ShownLook,
)
from services.live.motion.live_motion import LiveMotion
from services.live.room import MeetingPerformer
from services.live.settling_mean import SettlingMean

if TYPE_CHECKING:
    from renderer.live_look.live_look import LiveLook

log = logging.getLogger(__name__)

LOOK_SECONDS = Histogram(
    "metanerf_look_seconds",
    "Time in which a picture for live look is worked out, s.",
    buckets=(0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5),
)
_DRAWN_S = 1.0
"""Whom nobody has drawn for so long is drawn by no server."""
_STEP_S = 0.1
"""Between pictures, about."""
_MOST_BEHIND_S = 0.3
"""Later pictures are shown with motion that is ahead of them."""

Clock = Callable[[], float]


class LiveLooks:
    """Live look of all performers of this process."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        # one thread for all: what waits is replaced by newer pictures
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="live-look")

    def sink(self, performer: MeetingPerformer, motion: LiveMotion) -> LookSink:
        """What shows `performer`, who moves by `motion`."""
        return PerformerLook(motion, self._executor, self._clock)

    def close(self) -> None:
        """Stop the thread."""
        self._executor.shutdown(wait=False, cancel_futures=True)


class PerformerLook(LookSink):
    """One performer as they look now."""

    def __init__(self, motion: LiveMotion, executor: Executor, clock: Clock) -> None:
        self._motion, self._executor, self._clock = motion, executor, clock
        self._lock = threading.Lock()
        self._waiting: tuple[LookPicture, PoseRequest | None] | None = None
        self._working = False
        self._drawn: tuple[PerformerModel, float] | None = None
        """The model that is drawn, and when it was last."""
        self._look: tuple[PerformerModel, LiveLook] | None = None
        self._shown: tuple[PerformerModel, ShownLook] | None = None
        self._times_stopped = 0
        self._behind = SettlingMean(0.0)
        self._keeping = Keeping(clock)

    @property
    def keeping(self) -> Keeping:
        """What is kept of the pictures."""
        return self._keeping

    def receive(self, picture: LookPicture, request: PoseRequest | None = None) -> None:
        """Take the newest picture; returns at once."""
        with self._lock:
            self._waiting = picture, request
            idle, self._working = not self._working, True
        if idle:
            self._executor.submit(self._work)

    def stop(self) -> None:
        """Show none any more, at once."""
        with self._lock:
            self._times_stopped += 1
            self._waiting = self._shown = self._look = None

    def shown_of(self, model: PerformerModel) -> ShownLook | None:
        """How `model` looks now; asking tells that it is drawn."""
        self._drawn = model, self._clock()
        shown = self._shown
        return shown[1] if shown is not None and shown[0] is model else None

    def _work(self) -> None:
        """On the thread: the newest picture, then those of other performers."""
        with self._lock:
            waiting, self._waiting = self._waiting, None
            stopped = self._times_stopped
        try:
            if waiting is not None:
                self._show(*waiting, stopped)
        except Exception:
            # an error in one picture must not end live look
            log.exception("a picture could not be shown")
        with self._lock:
            self._working = again = self._waiting is not None
        if again:
            self._executor.submit(self._work)

    def _show(self, picture: LookPicture, request: PoseRequest | None, stopped: int) -> None:
        begun_s = self._clock()
        drawn = self._drawn_at(begun_s)
        model = drawn or (request and request.model) or self._keeping.model
        solved = self._motion.solved(picture.captured_ms)
        splats = None if model is None else model.splats
        if model is None or splats is None or solved is None:
            return
        look = self._look_of(model, splats)
        camera = cropped(solved.camera, picture)
        seen = seen_of(picture, solved.camera, solved.pose)
        aligned = look.align(seen)
        moment_s = solved.pose.time_s + (self._motion.clock_offset_s or 0.0)
        if request is not None:
            pelvis = splats.skeleton.rest_joints[0] + aligned.pose.root_translation
            request.deliver(AlignedPose(aligned.pose, pelvis, camera, moment_s))
        self._keeping.look_at(splats, seen, aligned.pose)
        shown = None
        if drawn is not None:
            appearance = look.take_colours(seen, aligned)
            behind_s = min(max(self._clock() - moment_s, 0.0), _MOST_BEHIND_S)
            self._behind.add(behind_s, _STEP_S)
            shown = model, ShownLook(appearance, self._behind.value)
        LOOK_SECONDS.observe(self._clock() - begun_s)
        with self._lock:
            if self._times_stopped == stopped:
                self._look, self._shown = (model, look), shown

    def _drawn_at(self, now_s: float) -> PerformerModel | None:
        """The model that the server draws; None where nobody sees its pictures."""
        drawn = self._drawn
        return drawn[0] if drawn is not None and now_s - drawn[1] <= _DRAWN_S else None

    def _look_of(self, model: PerformerModel, splats: SplatModel) -> LiveLook:
        from renderer.live_look.live_look import LiveLook

        look = self._look
        # a better model of them may have come meanwhile
        return look[1] if look is not None and look[0] is model else LiveLook(splats)


def seen_of(picture: LookPicture, whole: Camera, pose: Pose) -> WebcamPicture:
    """What of a sent picture the webcam, whose `whole` picture has that camera, saw.

    The square that is sent may reach beyond. There nothing is known: taken for a place where nobody
    is, it would draw limbs and hips away from it.
    """
    x, y, side = picture.window
    height, width = picture.matte.shape
    columns = _inside(x, side, whole.width, width)
    rows = _inside(y, side, whole.height, height)
    camera = cropped(whole, picture).cropped(
        columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start
    )
    rgb, matte = (np.ascontiguousarray(of[rows, columns]) for of in (picture.rgb, picture.matte))
    return WebcamPicture(rgb, matte, camera, pose)


def _inside(start: int, side: int, whole_px: int, sent_px: int) -> slice:
    """Which of the `sent_px` pixels of a square lie in the picture, at least one."""
    scale = sent_px / side
    first = min(max(math.ceil(-start * scale), 0), sent_px - 1)
    return slice(first, min(max(math.floor((whole_px - start) * scale), first + 1), sent_px))


def cropped(camera: Camera, picture: LookPicture) -> Camera:
    """The camera of a sent picture, of whose whole picture `camera` is."""
    x, y, side = picture.window
    height, width = picture.matte.shape
    return camera.cropped(x, y, side, side).resized(width, height)
