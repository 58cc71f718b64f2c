"""The silhouette: the surface stays inside the mask, and reaches the mask's outline.

How far outside a vertex lies is read from a distance map, small but counted from the edge itself.
An outline is reached by the vertex that makes it: one that is seen from the side, close by, and
faces the way the outline does, as iterative closest points with normals pick theirs (Rusinkiewicz
and Levoy 2001). Which it is, is looked up every few steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import torch
import torch.nn.functional as nnf
from torch.autograd import Function

from capture.fitting.kinematics import array_of
from capture.fitting.observations import Observations
from capture.fitting.robust import geman_mcclure, pseudo_huber
from capture.fitting.state import FitBody, PosedClip
from capture.fitting.surface import SurfaceSamples
from capture.fitting.term import Term
from capture.fitting.terms.silhouette_kernels import look_up
from capture.fitting.window import Window, window_around
from scene.arrays import Array, Float, Int, Tensor

DEVIATION = 0.008
"""Of an outline, in heights of the person."""
FAR_OFF = 4.0
"""Times the clip's median energy from which a frame's landmarks are taken for something else's: the
estimator puts crouching people into half of themselves, and backs before fronts."""
_CONTOUR_SPACING_M = 0.025
"""Of the vertices that outlines are looked up among: coarser ones leave gaps of pixels."""
SIDE_PX = 256
"""Longest side of the pictures in which distances are measured."""
CONTOUR_POINTS = 128
_INSIDE_WEIGHT = 20.0
"""Weight of vertices outside the mask: nearly all lie inside in any pose."""
_OUTLIER = 20.0
"""Deviations from which an outline point is an outlier."""
_FAR = 0.15
"""Distances beyond this share of the window's longest side count as that."""
_SMOOTH_PX = 2.0
"""Blur in which the outline's direction is read."""
_TANGENTIAL = 0.3
"""Weight of the error along the outline, relative to that across it."""
_CANDIDATES = 600
"""Vertices of a frame that may lie on its outline: those seen most from the side."""
_FACES_PX = 15.0
"""Pixels that a vertex counts as further off for each unit between its normal and the outline's."""


class SilhouetteDistance(Term):
    """Mean energy a frame of the surface outside the mask and of the outline off the surface."""

    weight = 18.0

    def __init__(self, body: FitBody, seen: Observations) -> None:
        super().__init__(body, seen)
        self._contour = SurfaceSamples.spread(body.model, _CONTOUR_SPACING_M)
        self._nearest: Int[Tensor, "F P"] | None = None
        self._shown = seen.shown[:, body.surface.owners]

    @cached_property
    def silhouettes(self) -> Silhouettes:
        """Made when first asked for, as the pictures of `OpticalFlow`."""
        return prepare_silhouettes(self.seen.masks)

    def associate(self, clip: PosedClip) -> None:
        contour = self._contour.posed(clip.posed)
        normals = self._contour.normals_of(clip.posed)
        self._nearest = self.silhouettes.nearest(clip.project(contour), normals, contour)

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        return self.frame_energies(clip).mean()

    def frame_energies(self, clip: PosedClip) -> Float[Tensor, "F"]:
        """The energy of each frame, between what was last associated."""
        assert self._nearest is not None
        reached = clip.project(self._contour.posed_at(clip.posed, self._nearest))
        depth = -clip.posed.joint_positions[:, 0, 2].clamp_max(-0.1)
        clothing_px = clip.focal_px * clip.state.clothing_m / depth
        deviation_px = DEVIATION * self.seen.person_px
        return silhouette_energy(
            self.silhouettes, clip.surface_px, reached, self._shown, clothing_px, deviation_px
        )


@dataclass(frozen=True)
class Silhouettes:
    """Masks of all frames, prepared for the fit."""

    width: int
    """Of the full picture, px."""
    height: int
    window: Window
    distance: Float[Tensor, "F h w 3"]
    """From the middle of each of the window's pixels to the person, in its pixels (0 on them), and
    by how much it grows to the right and downwards."""
    contour: Float[Tensor, "F P 2"]
    """Points of the masks' outlines, px of the full picture."""
    normals: Float[Tensor, "F P 2"]
    """Outwards, unit length."""
    contour_weight: Float[Tensor, "F P"]
    """0 for points cut off by the picture's border and for lost frames."""
    known: Float[Tensor, "F"]
    """1 where the frame has a mask."""

    def outside(self, pixels: Float[Tensor, "F V 2"]) -> Float[Tensor, "F V"]:
        """Distance (px) of projected points to the mask; 0 inside it and outside the picture."""
        return _Outside.apply(pixels, self)

    @torch.no_grad()
    def nearest(
        self,
        pixels: Float[Tensor, "F V 2"],
        normals: Float[Tensor, "F V 3"],
        skin: Float[Tensor, "F V 3"],
    ) -> Tensor:
        """Index [F P] of the vertex that makes each point of the outline: one that is seen from
        the side, nearby, and faces the way the outline does."""
        facing = (normals * nnf.normalize(skin, dim=-1)).sum(-1).abs()
        grazing = facing.topk(min(_CANDIDATES, facing.shape[1]), dim=1, largest=False).indices
        flat = nnf.normalize(normals[..., :2] * torch.tensor([1.0, -1.0]), dim=-1)
        vertices = torch.cat([pixels, _FACES_PX * flat], -1)
        vertices = torch.gather(vertices, 1, grazing[..., None].expand(-1, -1, 4))
        outline = torch.cat([self.contour, _FACES_PX * self.normals], -1)
        # |v|^2 - 2 c v orders like the distance, at a third of its cost
        lengths = vertices.square().sum(-1)[:, None]
        found = torch.baddbmm(lengths, outline, vertices.transpose(1, 2), alpha=-2.0).argmin(-1)
        return torch.gather(grazing, 1, found)


class _Outside(Function):
    @staticmethod
    def forward(ctx: Any, pixels: Tensor, masks: Silhouettes) -> Tensor:
        w, slopes = masks.window, pixels.new_empty(pixels.shape)
        outside = pixels.new_empty(pixels.shape[:2])
        look_up(
            array_of(pixels),
            masks.distance.numpy(),
            masks.known.numpy(),
            (float(w.x), float(w.y), float(w.scale)),
            (masks.width, masks.height),
            outside.numpy(),
            slopes.numpy(),
        )
        ctx.save_for_backward(slopes)
        return outside

    @staticmethod
    def backward(ctx: Any, by_outside: Tensor) -> tuple[Tensor, None]:
        (slopes,) = ctx.saved_tensors
        return by_outside[..., None] * slopes, None


def prepare_silhouettes(masks: Sequence[Float[Array, "H W"] | None]) -> Silhouettes:
    """Distance maps and outlines of `masks` (None: the person was lost)."""
    window = window_around(masks, SIDE_PX)
    height, width = next(m.shape for m in masks if m is not None)
    size = window.size
    distances = np.zeros((len(masks), size[1], size[0], 3), dtype=np.float32)
    contour = np.zeros((len(masks), CONTOUR_POINTS, 2), dtype=np.float32)
    normals, weight = np.zeros_like(contour), np.zeros(contour.shape[:2], np.float32)
    known = np.zeros(len(masks), dtype=np.float32)
    for index, mask in enumerate(masks):
        if mask is None or mask.max() < 0.5:
            continue
        small = (window.cut(mask) > 0.5).astype(np.uint8)
        if not small.any():
            continue
        known[index] = 1.0
        distance = cv2.distanceTransform(1 - small, cv2.DIST_L2, 5)
        # counted from the middle of the nearest pixel, whose edge is half a pixel nearer
        distance = np.clip(distance - 0.5, 0.0, _FAR * max(size))
        distances[index] = np.stack([distance, *np.gradient(distance)[::-1]], axis=-1)
        contour[index], normals[index], weight[index] = _outline(mask)
    return Silhouettes(
        width,
        height,
        window,
        torch.from_numpy(distances),
        torch.from_numpy(contour),
        torch.from_numpy(normals),
        torch.from_numpy(weight),
        torch.from_numpy(known),
    )


def silhouette_energy(
    silhouettes: Silhouettes,
    pixels: Float[Tensor, "F V 2"],
    reached: Float[Tensor, "F P 2"],
    shown: Float[Tensor, "F V"],
    clothing_px: Float[Tensor, "F"],
    deviation_px: Float[Tensor, "F"],
) -> Float[Tensor, "F"]:
    """Mean energy of both directions, a frame.

    `pixels` stay inside unless they are not `shown` (0: a limb behind a table may lie outside the
    mask); `reached` is where the vertices lie that make the outline, `clothing_px` how much further
    out it is.
    """
    outside = silhouettes.outside(pixels) / deviation_px[:, None]
    inwards = _INSIDE_WEIGHT * (pseudo_huber(outside.square()) * shown).mean(1)
    worn = clothing_px[:, None, None] * silhouettes.normals
    gap = (reached + worn - silhouettes.contour) / deviation_px[:, None, None]
    across = (gap * silhouettes.normals).sum(-1).square()
    squared = across + _TANGENTIAL**2 * (gap.square().sum(-1) - across)
    reach = geman_mcclure(squared, _OUTLIER) * silhouettes.contour_weight
    return inwards + reach.sum(1) / silhouettes.contour_weight.sum(1).clamp_min(1.0)


def _outline(mask: Array) -> tuple[Array, Array, Array]:
    """Evenly spaced points of the outlines of `mask`, their normals and weights."""
    solid = (mask > 0.5).astype(np.uint8)
    contours, _ = cv2.findContours(solid, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = np.concatenate(contours)[:, 0].astype(np.int64)
    chosen = points[np.linspace(0, len(points) - 1, CONTOUR_POINTS).astype(int)]
    height, width = mask.shape
    inside = (chosen > 3).all(1) & (chosen[:, 0] < width - 3) & (chosen[:, 1] < height - 3)
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), _SMOOTH_PX)
    slope = np.stack([cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1)], -1)
    normals = -slope[chosen[:, 1], chosen[:, 0]]
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    # the middles of the outermost pixels lie half a pixel within the outline
    return chosen + 0.5 + 0.5 * normals, normals, inside.astype(np.float32)
