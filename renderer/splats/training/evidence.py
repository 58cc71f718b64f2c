"""How well the pixels of the frames determine the colour of each splat."""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import ALPHA, CONIC_A, CONIC_B, CONIC_C, EMPTY_BOX
from renderer.splats.rasteriser.workspace import Workspace
from scene.arrays import Array, Bool, Float

SEEN_PX = 0.05
"""Evidence from which a splat counts as seen. A splat that lies open has about 1 px, one behind the
body a thousandth."""
GRAZING = 0.4
"""Cosine between surface and view below which evidence counts less: at the rim, small pose errors
give a splat the background's colour."""
_AT_THE_RIM = 0.3
"""How much less. It does count: hair and cloth that stand off the body are seen by splats whose
surface faces sideways."""
_FRAMES, _BEST_SHARE = 40, 0.1
"""Frames looked at, and the share of them, the best for each splat, that counts."""


def frames_looked_at(count: int) -> range:
    """Some of `count` frames, spread evenly."""
    return range(0, count, max(1, count // _FRAMES))


def shown_pixels(
    work: Workspace, contribution: Float[Array, "N"], facing: Bool[Array, "N"]
) -> Float[Array, "N"]:
    """Pixels that show each splat in the frame that `work` has arranged, times the share of its
    own light that reaches them: about the sum of its squared blending weights.

    Args:
        contribution: summed blending weights, px.
        facing: where the surface faces the camera.
    """
    p = work.projected
    # a splat alone would blend its opacity times the area of its Gaussian, 2 pi / sqrt(det)
    density = np.maximum(p[:, CONIC_A] * p[:, CONIC_C] - p[:, CONIC_B] ** 2, 1e-12)
    alone = 2.0 * np.pi * p[:, ALPHA] / np.sqrt(density)
    reaches = np.minimum(contribution / np.maximum(alone, 1e-6), 1.0)
    pixels = contribution * reaches * np.where(facing, 1.0, _AT_THE_RIM)
    return np.where(work.boxes[:, 0] != EMPTY_BOX, pixels, 0.0)


def in_best_frames(pixels: Float[Array, "F N"]) -> Float[Array, "N"]:
    """Each splat's mean over the frames that show it best."""
    best = max(1, round(_BEST_SHARE * len(pixels)))
    return np.sort(pixels, axis=0)[-best:].mean(axis=0)
