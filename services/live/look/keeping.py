"""The pictures of one performer that are kept until their owner says what becomes of them.

They are in memory alone: whoever leaves without a word, and a process that ends, drop them.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from renderer.live_look.picture import WebcamPicture
from renderer.splats.model import SplatModel
from scene.motion import Pose

if TYPE_CHECKING:
    from renderer.live_look.frame_keeper import FrameKeeper, KeptFrame

_EVERY_S = 0.4
"""Between pictures that are looked at: a side is seen for longer, and looking takes time."""


class Keeping:
    """Off until it is switched on. Safe to use from several threads."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._keeper: FrameKeeper | None = None
        self._on = False
        self._due_s = 0.0

    @property
    def on(self) -> bool:
        """Whether pictures are being kept."""
        return self._on

    @property
    def model(self) -> SplatModel | None:
        """Whose sides are looked for, while pictures are being kept."""
        keeper = self._keeper
        return keeper.model if self._on and keeper is not None else None

    def start(self, model: SplatModel) -> None:
        """Keep pictures that show what `model` has not seen; those kept already stay."""
        from renderer.live_look.frame_keeper import FrameKeeper

        with self._lock:
            if self._keeper is None:
                self._keeper, self._due_s = FrameKeeper(model), -math.inf
            self._on = True

    def stop(self) -> None:
        """Keep no more."""
        with self._lock:
            self._on = False

    def drop(self) -> None:
        """Keep no more, and forget what was kept."""
        with self._lock:
            self._keeper, self._on = None, False

    def take(self) -> tuple[SplatModel, list[KeptFrame]] | None:
        """What was kept, with the model in whose world it is; None without any. It is dropped."""
        with self._lock:
            keeper, self._keeper, self._on = self._keeper, None, False
        if keeper is None or not keeper.best.frames:
            return None
        return keeper.model, keeper.best.frames

    @property
    def frames(self) -> list[KeptFrame]:
        """What is kept now."""
        with self._lock:
            return [] if self._keeper is None else self._keeper.best.frames

    def look_at(self, model: SplatModel, picture: WebcamPicture, pose: Pose) -> None:
        """Keep `picture` if it is worth it; `pose` of `model` is aligned with it."""
        keeper, now_s = self._keeper, self._clock()
        if not self._on or keeper is None or keeper.model is not model or now_s < self._due_s:
            return
        self._due_s = now_s + _EVERY_S
        found = keeper.look_at(replace(picture, pose=pose))
        with self._lock:
            # switched off or dropped meanwhile, it keeps nothing
            if found is not None and self._on and self._keeper is keeper:
                keeper.best.offer(found)
