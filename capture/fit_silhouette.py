"""The silhouette term: the surface stays inside the mask, and the mask's edge is reached by it.

Both directions are distances in pixels of a small picture. Inside-ness is read from a distance map;
reach is the distance from points of the mask's contour to the nearest projected vertex, whose index
is looked up every few steps only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
import torch.nn.functional as nnf

from capture.fit_terms import robust, very_robust
from scene.arrays import Array, Float, Tensor

SIDE_PX = 256
"""Longest side of the pictures in which distances are measured."""
CONTOUR_POINTS = 96
_INWARDS = 20.0
"""Most points lie inside whatever happens: the few that stick out must be heard."""
_GIVES_UP = 20.0
"""Deviations from which an outline point is taken for somebody else's."""
_FAR = 0.15
"""Distances beyond this share of the picture's longest side count as that."""


@dataclass(frozen=True)
class Silhouettes:
    """Masks of all frames, prepared for the fit."""

    distance: Float[Tensor, "F 1 h w"]
    """Pixels (full-size) to the nearest pixel of the person; 0 on them."""
    contour: Float[Tensor, "F P 2"]
    """Points of the masks' outlines, px of the full picture."""
    contour_weight: Float[Tensor, "F P"]
    """0 for points cut off by the picture's border and for lost frames."""
    known: Float[Tensor, "F"]
    """1 where the frame has a mask."""
    width: int
    height: int

    def outside(self, pixels: Float[Tensor, "F V 2"]) -> Float[Tensor, "F V"]:
        """Distance (px) of projected points to the mask; 0 inside it and outside the picture."""
        size = torch.tensor([self.width, self.height], dtype=torch.float32)
        grid = (2.0 * pixels / size - 1.0)[:, :, None]
        found = nnf.grid_sample(self.distance, grid, padding_mode="border", align_corners=False)[
            :, 0, :, 0
        ]
        seen = (grid[..., 0, :].abs() < 1.0).all(-1)
        return found * seen * self.known[:, None]

    @torch.no_grad()
    def nearest(self, pixels: Float[Tensor, "F V 2"]) -> Tensor:
        """Index [F P] of the projected point nearest to each point of the outline."""
        # |v|^2 - 2 c v orders like the distance, at a third of its cost
        lengths = pixels.square().sum(-1)[:, None]
        return torch.baddbmm(lengths, self.contour, pixels.transpose(1, 2), alpha=-2.0).argmin(-1)


def prepare_silhouettes(masks: Sequence[Float[Array, "H W"] | None]) -> Silhouettes:
    """Distance maps and outlines of `masks` (None: the person was lost)."""
    height, width = next(m.shape for m in masks if m is not None)
    scale = min(1.0, SIDE_PX / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    distances = np.zeros((len(masks), 1, size[1], size[0]), dtype=np.float32)
    contour = np.zeros((len(masks), CONTOUR_POINTS, 2), dtype=np.float32)
    weight = np.zeros((len(masks), CONTOUR_POINTS), dtype=np.float32)
    known = np.zeros(len(masks), dtype=np.float32)
    for index, mask in enumerate(masks):
        if mask is None or mask.max() < 0.5:
            continue
        small = (cv2.resize(mask, size, interpolation=cv2.INTER_AREA) > 0.5).astype(np.uint8)
        if not small.any():
            continue
        known[index] = 1.0
        far = _FAR * max(size)
        distance = cv2.distanceTransform(1 - small, cv2.DIST_L2, 5)
        distances[index, 0] = np.minimum(distance, far) / scale
        contour[index], weight[index] = _outline(mask)
    return Silhouettes(
        torch.from_numpy(distances),
        torch.from_numpy(contour),
        torch.from_numpy(weight),
        torch.from_numpy(known),
        width,
        height,
    )


def silhouette_energy(
    silhouettes: Silhouettes,
    pixels: Float[Tensor, "F V 2"],
    nearest: Tensor,
    shown: Float[Tensor, "F V"],
    deviation_px: float,
) -> Float[Tensor, "F"]:
    """Mean energy of both directions, a frame.

    Points that are not `shown` (0: a limb behind a table) may lie outside the mask.
    """
    outside = silhouettes.outside(pixels) / deviation_px
    inwards = _INWARDS * (robust(outside.square()) * shown).mean(1)
    reached = torch.gather(pixels, 1, nearest[..., None].expand(-1, -1, 2))
    gap = (reached - silhouettes.contour) / deviation_px
    reach = very_robust(gap.square().sum(-1), _GIVES_UP) * silhouettes.contour_weight
    return inwards + reach.sum(1) / silhouettes.contour_weight.sum(1).clamp_min(1.0)


def _outline(mask: Array) -> tuple[Array, Array]:
    """Evenly spaced points of the outlines of `mask`, and their weights."""
    solid = (mask > 0.5).astype(np.uint8)
    contours, _ = cv2.findContours(solid, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = np.concatenate(contours)[:, 0].astype(np.float32)
    chosen = points[np.linspace(0, len(points) - 1, CONTOUR_POINTS).astype(int)] + 0.5
    height, width = mask.shape
    inside = (chosen > 3).all(1) & (chosen[:, 0] < width - 3) & (chosen[:, 1] < height - 3)
    return chosen, inside.astype(np.float32)
