"""How well the pixels of the frames determine the colour of each splat."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from renderer.splats.layout import ALPHA, CONIC_A, CONIC_B, CONIC_C, EMPTY_BOX, POSITION
from renderer.splats.rasteriser.workspace import Workspace
from renderer.splats.training.initialisation import FirstSplats
from scene.arrays import Array, Bool, Float, Int

SEEN_PX = 0.05
"""Evidence from which a splat counts as seen, where one that lies open has about 1 px; one behind
the body has a thousandth."""
_OPEN = 95.0
"""Percentile, among splats that frames show at all, of one that lies open."""
_GRAZING = 0.4
"""Cosine between surface and view below which evidence counts less: at the rim, small pose errors
give a splat the background's colour."""
_AT_THE_RIM = 0.3
"""How much less. It does count: hair and cloth that stand off the body are seen by splats whose
surface faces sideways."""
_AWAY = -0.3
"""Cosine below which nothing counts: what shines through from behind is no colour of the back's."""
_FRAMES, _BEST_SHARE = 40, 0.1
"""Frames looked at, and the share of them, the best for each splat, that counts."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Pixels that show each splat, at most one, times the share of its light that reaches
    them."""

    pixels: Float[Array, "N"]
    """Counted less at the rim."""
    facing: Float[Array, "N"]
    """Of frames alone in which the surface faces the camera: what may lend its colour to others."""
    open_px: float
    """Of a splat that lies open: 1, or less where splats are denser than pixels."""

    @property
    def seen(self) -> Bool[Array, "N"]:
        """Which splats the frames show."""
        return self.pixels > SEEN_PX * self.open_px

    @property
    def hidden(self) -> Bool[Array, "N"]:
        """Which splats not even a rim shows."""
        return self.pixels == 0.0

    def without(self, splats: Bool[Array, "N"]) -> Evidence:
        """As if nothing had shown those `splats`."""
        return Evidence(
            np.where(splats, 0.0, self.pixels), np.where(splats, 0.0, self.facing), self.open_px
        )

    def taken(self, splats: Int[Array, "K"]) -> Evidence:
        """Of those `splats`, in this order."""
        return Evidence(self.pixels[splats], self.facing[splats], self.open_px)

    @classmethod
    def of_frames(cls, shown: Float[Array, "F N"], cosines: Float[Array, "F N"]) -> Evidence:
        """From `shown_pixels` of some frames and the `surface_cosines` there."""
        faces, rim = cosines > _GRAZING, np.where(cosines > _AWAY, _AT_THE_RIM, 0.0)
        return cls.of(
            _in_best_frames(shown * np.where(faces, 1.0, rim)),
            _in_best_frames(np.where(faces, shown, 0.0)),
        )

    @classmethod
    def of(cls, pixels: Float[Array, "N"], facing: Float[Array, "N"]) -> Evidence:
        """Of all splats, from `pixels` and `facing`."""
        some = pixels[pixels > 0.0]
        return cls(pixels, facing, float(np.percentile(some, _OPEN)) if len(some) else 0.0)


def frames_looked_at(count: int) -> range:
    """Some of `count` frames, spread evenly."""
    return range(0, count, max(1, count // _FRAMES))


def shown_pixels(work: Workspace, contribution: Float[Array, "N"]) -> Float[Array, "N"]:
    """Pixels that show each splat in the frame that `work` has arranged, at most one, times the
    share of its own light that reaches them: of a large one, of which the body's rim shows a
    sliver, many pixels may tell hardly anything.

    Args:
        contribution: summed blending weights, px.
    """
    p = work.projected
    # a splat alone would blend its opacity times the area of its Gaussian, 2 pi / sqrt(det)
    density = np.maximum(p[:, CONIC_A] * p[:, CONIC_C] - p[:, CONIC_B] ** 2, 1e-12)
    alone = 2.0 * np.pi * p[:, ALPHA] / np.sqrt(density)
    reaches = np.minimum(contribution / np.maximum(alone, 1e-6), 1.0)
    shown = np.minimum(contribution, 1.0) * reaches
    return np.where(work.boxes[:, 0] != EMPTY_BOX, shown, 0.0)


def surface_cosines(
    first: FirstSplats, transforms: Float[Array, "K 4 4"], eye: Float[Array, "3"]
) -> Float[Array, "N"]:
    """Cosine between the body's surface at each splat's first position and the way to `eye`."""
    blended = np.einsum("ns,nsij->nij", first.weights, transforms[first.joints][:, :, :3])
    rest = first.parameters[:, POSITION : POSITION + 3]
    place = np.einsum("nij,nj->ni", blended[:, :, :3], rest) + blended[:, :, 3]
    normal = np.einsum("nij,nj->ni", blended[:, :, :3], first.normals)
    away = eye - place
    return (normal * away).sum(axis=1) / np.maximum(np.linalg.norm(away, axis=1), 1e-9)


def _in_best_frames(pixels: Float[Array, "F N"]) -> Float[Array, "N"]:
    """Each splat's mean over the frames that show it best."""
    best = max(1, round(_BEST_SHARE * len(pixels)))
    return np.sort(pixels, axis=0)[-best:].mean(axis=0)
