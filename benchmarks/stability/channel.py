"""The way of keypoints from a page to the server, as bad as is wanted. Times in seconds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.body.landmark_names import LANDMARK_NAMES
from capture.body.landmarks import MIRROR
from scene.arrays import Array

LATENCY_S = 0.03
"""Of a packet that nothing delays."""
_OUTAGE_EVERY_S = 2.0
_SILENT_FROM_S = 3.0
_LEFT_ARM = ("left_elbow", "left_wrist", "left_pinky", "left_index", "left_thumb")
_FACE = LANDMARK_NAMES[:11]
_LEGS = tuple(
    f"{side}_{part}"
    for side in ("left", "right")
    for part in ("knee", "ankle", "heel", "foot_index")
)
_GONE: dict[str, tuple[str, ...]] = {
    "nothing": (),
    "the face": _FACE,
    "an arm": _LEFT_ARM,
    "the legs": _LEGS,
}
MISSING = tuple(_GONE)


@dataclass(frozen=True)
class Channel:
    """A connection and an estimator; as they are here, nothing is wrong."""

    rate_hz: float = 30.0
    loss: float = 0.0
    """Share of packets that never come, each by itself."""
    outage_s: float = 0.0
    """How long nothing comes, every two seconds."""
    silence_s: float = 0.0
    """How long nothing comes, once."""
    jitter_s: float = 0.0
    """Packets are late by anything up to this; they may overtake one another."""
    skew: float = 0.0
    """The camera's clock is fast by this share."""
    missing: str = "nothing"
    """Of `MISSING`: not seen by the estimator."""
    dropped: float = 0.0
    """Share of the landmarks that are not seen, in each frame others."""
    exchanged: float = 0.0
    """Share of the frames in which left and right are exchanged."""

    def deliveries(self, until_s: float, rng: np.random.Generator) -> list[tuple[float, float]]:
        """When each packet that arrives was sent and when it arrives, by arrival."""
        sent = np.arange(0.0, until_s, 1.0 / self.rate_hz)
        arrives = sent + LATENCY_S + self.jitter_s * rng.uniform(size=len(sent))
        lost = rng.uniform(size=len(sent)) < self.loss
        if self.outage_s:
            lost |= sent % _OUTAGE_EVERY_S < self.outage_s
        lost |= (sent >= _SILENT_FROM_S) & (sent < _SILENT_FROM_S + self.silence_s)
        kept = zip(sent[~lost].tolist(), arrives[~lost].tolist(), strict=True)
        return sorted(kept, key=lambda one: one[1])

    def camera_time_s(self, time_s: float) -> float:
        """What the camera's clock says."""
        return time_s * (1.0 + self.skew)

    def seen(
        self, pixels: Array, world: Array, rng: np.random.Generator
    ) -> tuple[Array, Array, Array]:
        """Landmarks [33 2], [33 3] as the estimator gives them, and their visibility [33]."""
        visibility = np.ones(len(LANDMARK_NAMES))
        visibility[[LANDMARK_NAMES.index(name) for name in _GONE[self.missing]]] = 0.0
        visibility[rng.uniform(size=len(visibility)) < self.dropped] = 0.0
        if rng.uniform() < self.exchanged:
            order = list(MIRROR)
            pixels, world = pixels[order], world[order]
        return pixels, world, visibility
