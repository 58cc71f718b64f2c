"""How far fingers bend in each frame: as captured, then as its picture shows.

Landmarks of a hand of some 40 px, blurred as it moves, are off by a finger's width, and splats of a
finger that is elsewhere take the colour of what lies there. The gradient of a step by the places of
splats tells which way each finger should bend: Adam (Kingma and Ba 2015) of the frame's own, drawn
to what was captured and to how its neighbours in time were changed.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.expressions import ClipBlendShapes
from renderer.splats.model import SplatModel
from scene.arrays import Array, Float
from scene.expression import CURLS
from scene.sequence import Sequence

_FROM = 0.25
"""Share of a training before which splats do not look like anybody's hand yet."""
_RATE = 0.03
"""Of a curl, each time a frame is looked at: some twenty times in a training."""
_BETAS = (0.7, 0.9)
_FLOOR = 0.3
"""How little a finger moves that hardly shows: this share of the typical gradient counts in
every frame."""
_TO_CAPTURED, _TO_NEIGHBOURS = 0.02, 0.1
"""Shares of the difference that a look takes back."""


class FingerBends:
    """Of all frames of a clip."""

    def __init__(self, sequence: Sequence, start: SplatModel | None = None) -> None:
        """They go on from those of `start`, an earlier model of the same clip."""
        captured = sequence.motion.expressions
        self._captured = captured[:, CURLS]
        self.expressions = captured.copy()
        """Of each frame; curls change in place."""
        same_clip = start is not None and start.data_hash == sequence.data_hash
        if start is not None and same_clip and len(start.motion) == len(captured):
            self.expressions[:, CURLS] = start.motion.expressions[:, CURLS]
        self._moments = np.zeros((2, *self._captured.shape))
        self._looks = np.zeros(len(captured), np.int64)

    def learn(
        self, frame: int, shapes: ClipBlendShapes, gradient: Float[Array, "N P"], fraction: float
    ) -> None:
        """Bend the fingers of `frame` a little further.

        Args:
            shapes: of the splats, with these expressions.
            gradient: of the loss, by the splats as `frame` shows them.
            fraction: of the training that is done.
        """
        if fraction < _FROM:
            return
        by_curls = shapes.by_curls(gradient, frame)
        self._looks[frame] += 1
        betas = np.array(_BETAS)[:, None]
        values = np.stack([by_curls, by_curls**2])
        self._moments[:, frame] = betas * self._moments[:, frame] + (1.0 - betas) * values
        mean, square = self._moments[:, frame] / (1.0 - betas ** self._looks[frame])
        scale = np.sqrt(square) + _FLOOR * np.sqrt(self._moments[1].mean(axis=0)) + 1e-12
        change = self.expressions[frame, CURLS] - self._captured[frame] - _RATE * mean / scale
        change *= 1.0 - _TO_CAPTURED
        beside = [one for one in (frame - 1, frame + 1) if 0 <= one < len(self._captured)]
        if beside:
            others = self.expressions[beside, CURLS] - self._captured[beside]
            change += _TO_NEIGHBOURS * (others.mean(axis=0) - change)
        self.expressions[frame, CURLS] = np.clip(self._captured[frame] + change, 0.0, 1.0)

    def state(self) -> dict[str, Array]:
        """Copies of what `restore` needs."""
        return {
            "bends": self.expressions[:, CURLS].copy(),
            "bends_moments": self._moments.copy(),
            "bends_looks": self._looks.copy(),
        }

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`."""
        self.expressions[:, CURLS] = state["bends"]
        self._moments, self._looks = state["bends_moments"].copy(), state["bends_looks"].copy()
