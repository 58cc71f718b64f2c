"""How a person's webcam sees them now, on the splats of their model."""

from __future__ import annotations

from dataclasses import dataclass

from scene.arrays import Array, Float


@dataclass(frozen=True, eq=False)
class LaidPicture:
    """What a webcam's picture shows of a person and the colours of N splats are too coarse for."""

    detail: Float[Array, "H W 3"]
    """Factor of the sRGB that the splats come to there; 1 where nothing is known."""
    places: Float[Array, "N 3"]
    """Where in the picture each splat's centre is (x and y, px), times how well it is seen, and
    that, 0 to 1."""
    webcam: Float[Array, "3"]
    """Where the webcam is as the chest sees it: at rest, m."""
    focal_px: float
    """Horizontal focal length of the picture."""


@dataclass(frozen=True, eq=False)
class LiveAppearance:
    """What live look makes of a model of N splats."""

    change: Float[Array, "N 3"]
    """What is added to their colours as captured, sRGB."""
    laid_picture: LaidPicture | None = None
    """Laid on them, where one looks from about the webcam's own place; None: none is."""
