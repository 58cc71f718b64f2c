"""Optical flow: the projected surface moves as the pictures do.

Landmarks locate joints, with independent errors in each frame; optical flow (DIS, Kroeger et al.
2016, by OpenCV) gives the motion of all visible skin and cloth between frames, finer than any
landmark and including rotations of limbs about their own axis. Only differences between frames
enter, so it couples frames without fixing absolute positions. Flow is arbitrary where there is no
texture, so it is weighted by the structure tensor (`certainty`).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
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
from capture.fitting.state import FitBody, PosedClip
from capture.fitting.term import Term
from capture.fitting.terms.flow_kernels import motion_energy, nearest_motion
from capture.fitting.window import Window, window_around
from scene.arrays import Array, Bool, Float, Int, Tensor, UInt8
from scene.dense_flow import dense_flow
from scene.structure_tensor import structure_tensor

_STRIDES = (1, 3)
"""Frames between the two pictures of a pair: near ones move little, far ones drift less."""
_MIN_STRIDES_S = (1 / 15, 3 / 15)
"""Least time between the pictures of a pair: at sixty frames a second, motion between neighbours is
below the flow's error."""
_SIDE_PX = 448
"""Longest side of the window in which flow is computed."""
_BACKGROUND_GREY = 128
"""Grey level in place of the static background."""
_GRID_PX = 8
_GRADIENT_STEPS = 12
"""Iterations on every scale, down to the pictures' own. Refining between patches cost a third more
and brought no joint nearer."""
_INITIAL_FLOW_PX = 25.0
"""Distance from a visible vertex, px of the window, within which flow is initialised by its
motion."""
_CONSISTENT_PX, _CONSISTENT_SHARE = 1.0, 0.05
"""Tolerances of the forward-backward check: px, and share of the displacement."""
_TEXTURE_PX, _NOISE = 4.0, 2.0
"""Deviation of the structure tensor's window, and the gradient, grey levels a pixel, at which the
motion across it has certainty one half."""
_MAX_DIFFERENCE = 24
"""Largest difference of grey levels of a match."""
_ON_PERSON, _EDGE_PX = 0.9, 2
"""Alpha from which a pixel shows only the person, and its least distance from other pixels."""
_MARGIN_PX = 24
"""Margin around the person."""
_EXTENDED_PX = 24
"""How far the person's colours are extended over the background, which would bias flow at edges."""
_FACING = 0.35
"""Cosine between a vertex' normal and the view direction from which it counts as visible."""
_IN_FRONT_M = 0.1
"""Vertices deeper than the nearest in their cell by more are hidden."""
_OUTLIER = 3.0
_FEW_VERTICES = 20.0
"""Visible vertices below which a pair of frames loses weight."""


_DEVIATION = 0.004
"""Deviation of the surface's motion between two pictures, in heights of the person."""
_CELL = 0.03
"""Side of a cell in which near vertices hide far ones, in heights of the person."""


class OpticalFlow(Term):
    """Error of the visible vertices' motion against optical flow, where pictures are given."""

    weight = 120.0

    def __init__(self, body: FitBody, seen: Observations) -> None:
        super().__init__(body, seen)
        self._flow: Flow | None = None
        self._targets: FlowTargets | None = None

    @cached_property
    def _pictures(self) -> PersonImages | None:
        """Made when first asked for: somebody waits for what landmarks alone tell."""
        return None if self.seen.images is None else PersonImages(self.seen.images, self.seen.masks)

    def prepare(self, clip: PosedClip, *, coarse: bool) -> None:
        if self._pictures is None:
            return
        visible = self._visible(clip)
        self._flow = find_flow(
            self._pictures,
            self.seen.takes,
            strides_of(self.seen.step_s),
            clip.surface_px.numpy(),
            visible.numpy(),
            coarse=coarse,
        )

    def associate(self, clip: PosedClip) -> None:
        if self._flow is not None:
            self._targets = flow_targets(self._flow, clip.surface_px, self._visible(clip))

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        if self._targets is None:
            return torch.zeros(())
        return flow_energy(self._targets, clip.surface_px, _DEVIATION * self.seen.person_px)

    def _visible(self, clip: PosedClip) -> Bool[Tensor, "F V"]:
        normals = self.body.surface.normals_of(clip.posed)
        cell_px = _CELL * self.seen.person_px
        return visible_vertices(clip.surface, clip.surface_px, normals, cell_px)


class PersonImages:
    """Grey images of the person without background, of all frames."""

    def __init__(
        self, images: Sequence[UInt8[Array, "H W 3"]], masks: Sequence[Float[Array, "H W"] | None]
    ) -> None:
        self.window = window_around(masks, _SIDE_PX)
        cut = [self._cut(image, mask) for image, mask in zip(images, masks, strict=True)]
        self.grey: list[UInt8[Array, "h w"]] = [grey for grey, _ in cut]
        self.person: list[Bool[Array, "h w"]] = [person for _, person in cut]
        self.certainty = torch.from_numpy(np.stack([certainty(grey) for grey in self.grey]))
        """Certainty of each pixel's motion [F h w 3] (`certainty`)."""

    def _cut(self, image: Array, mask: Array | None) -> tuple[Array, Array]:
        grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
        grey = self.window.cut(grey)
        if mask is None:
            return np.full(grey.shape, _BACKGROUND_GREY, np.uint8), np.zeros(grey.shape, bool)
        person = self.window.cut(mask) > _ON_PERSON
        edge = cv2.erode(person.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=_EDGE_PX)
        return _extend_person(grey, person), edge > 0


@dataclass(frozen=True, eq=False)
class Flow:
    """Displacement of each pixel, px of the full picture, for every stride; NaN where unknown."""

    window: Window
    displacements: dict[int, Float[Tensor, "pairs h w 2"]]
    certainty: Float[Tensor, "F h w 3"]
    """Certainty of the motion from each frame (`certainty`)."""

    def at(self, stride: int, pixels: Float[Tensor, "pairs V 2"]) -> Float[Tensor, "pairs V 2"]:
        """The motion at `pixels` of each pair's first picture; NaN outside and where unknown."""
        return self._sample(self.displacements[stride], pixels)

    def certainty_at(self, pixels: Float[Tensor, "F V 2"]) -> Float[Tensor, "F V 3"]:
        """Certainty of the motion from `pixels`; NaN outside."""
        return self._sample(self.certainty, pixels)

    def _sample(
        self, found: Float[Tensor, "F h w C"], pixels: Float[Tensor, "pairs V 2"]
    ) -> Float[Tensor, "pairs V C"]:
        _, height, width, _ = found.shape
        w = self.window
        place = ((pixels - torch.tensor([w.x, w.y])) * w.scale).floor().long()
        x, y = place.unbind(-1)
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        pair = torch.arange(len(pixels))[:, None]
        values = found[pair, y.clamp(0, height - 1), x.clamp(0, width - 1)].float()
        return torch.where(inside[..., None], values, torch.nan)


def strides_of(step_s: float) -> tuple[int, ...]:
    """Frames between the two pictures of a pair, for a clip with a picture every `step_s`."""
    long = zip(_STRIDES, _MIN_STRIDES_S, strict=True)
    return tuple(max(frames, round(apart_s / step_s)) for frames, apart_s in long)


def find_flow(
    pictures: PersonImages,
    takes: Int[Array, "F"],
    strides: Sequence[int],
    pixels: Float[Array, "F V 2"],
    visible: Bool[Array, "F V"],
    *,
    coarse: bool = False,
) -> Flow:
    """Flow between frames of the same take, initialised by the motion of the fit's `visible`
    vertices.

    `strides` are those of `strides_of`; `pixels` is where the vertices are in the full picture.
    `coarse` stops at half the resolution, for fits with larger errors. Flow is unknown where
    the forward-backward check fails, as at occlusions.
    """
    inside = pictures.window.inside(pixels.astype(np.float32))

    def pair_flow(first: int, second: int) -> Float[Array, "h w 2"]:
        if takes[first] != takes[second]:
            return _unknown_flow(pictures.grey[first])
        search = _flow_search(coarse=coarse)
        return _pair_flow(search, pictures, first, second, inside, visible)

    displacements: dict[int, Tensor] = {}
    with ThreadPoolExecutor(len(os.sched_getaffinity(0)), "flow") as pool:
        for stride in (s for s in strides if s < len(pictures.grey)):
            firsts = range(len(pictures.grey) - stride)
            pairs = pool.map(pair_flow, firsts, range(stride, len(pictures.grey)))
            displacements[stride] = torch.from_numpy(np.stack(list(pairs)))
    return Flow(pictures.window, displacements, pictures.certainty)


def visible_vertices(
    surface: Float[Tensor, "F V 3"],
    pixels: Float[Tensor, "F V 2"],
    normals: Float[Tensor, "F V 3"],
    cell_px: Float[Tensor, "F"],
) -> Bool[Tensor, "F V"]:
    """Vertices that face the camera (at the origin) and are not occluded in their cell."""
    facing = (normals * nnf.normalize(-surface, dim=-1)).sum(-1) > _FACING
    depth = -surface[..., 2]
    cells = (pixels / cell_px[:, None, None]).long().clamp(-(2**14), 2**14) + 2**14
    frame = torch.arange(len(surface))[:, None] * 2**32
    _, cell = torch.unique(frame + cells[..., 1] * 2**16 + cells[..., 0], return_inverse=True)
    nearest = torch.full((int(cell.max()) + 1,), torch.inf)
    nearest = nearest.scatter_reduce(0, cell.flatten(), depth.flatten(), "amin")
    return facing & (depth < nearest[cell] + _IN_FRONT_M)


@dataclass(frozen=True, eq=False)
class FlowTargets:
    """Displacements of the vertices by the flow, as last sampled."""

    displacements: dict[int, Float[Tensor, "pairs V 2"]]
    valid: dict[int, Float[Tensor, "pairs V"]]
    certainty: dict[int, Float[Tensor, "pairs V 3"]]


def flow_targets(
    flow: Flow, pixels: Float[Tensor, "F V 2"], visible: Bool[Tensor, "F V"]
) -> FlowTargets:
    """The flow at the vertices' current pixels, valid where both frames show them."""
    targets, certainties = FlowTargets({}, {}, {}), flow.certainty_at(pixels)
    for stride in flow.displacements:
        displacements = flow.at(stride, pixels[:-stride])
        known = torch.isfinite(displacements[..., 0]) & visible[:-stride] & visible[stride:]
        targets.valid[stride] = known.float()
        targets.displacements[stride] = torch.where(known[..., None], displacements, 0.0)
        targets.certainty[stride] = torch.where(known[..., None], certainties[:-stride], 0.0)
    return targets


def flow_energy(
    targets: FlowTargets, pixels: Float[Tensor, "F V 2"], deviation_px: Float[Tensor, "F"]
) -> Tensor:
    """Mean robust error over pairs, strides and visible vertices, weighted by certainty."""
    return _FlowEnergy.apply(pixels, targets, deviation_px)


class _FlowEnergy(Function):
    @staticmethod
    def forward(ctx: Any, pixels: Tensor, targets: FlowTargets, deviation_px: Tensor) -> Tensor:
        by_pixel = pixels.new_zeros(pixels.shape)
        energies = [
            motion_energy(
                array_of(pixels),
                stride,
                array_of(displacements),
                array_of(targets.valid[stride]),
                array_of(targets.certainty[stride]),
                array_of(deviation_px),
                _OUTLIER,
                _FEW_VERTICES,
                by_pixel.numpy(),
            )
            for stride, displacements in targets.displacements.items()
        ]
        strides = max(len(energies), 1)
        ctx.save_for_backward(by_pixel / strides)
        return pixels.new_tensor(sum(energies) / strides)

    @staticmethod
    def backward(ctx: Any, by_energy: Tensor) -> tuple[Tensor, None, None]:
        (by_pixel,) = ctx.saved_tensors
        return by_energy * by_pixel, None, None


def _flow_search(*, coarse: bool) -> cv2.DISOpticalFlow:
    """One for each pair: it keeps what it works with, so that threads can share none."""
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    search.setFinestScale(int(coarse))
    search.setGradientDescentIterations(_GRADIENT_STEPS)
    search.setVariationalRefinementIterations(0)
    return search


def _pair_flow(
    search: cv2.DISOpticalFlow,
    pictures: PersonImages,
    first: int,
    second: int,
    pixels: Array,
    visible: Array,
) -> Float[Array, "h w 2"]:
    """Flow on the person, computed in a window around both pictures' person."""
    person = pictures.person[first]
    flow = _unknown_flow(person)
    covered = np.argwhere(person | pictures.person[second])
    if not len(covered):
        return flow
    first_px, last_px = covered.min(axis=0) - _MARGIN_PX, covered.max(axis=0) + _MARGIN_PX
    part = tuple(
        slice(max(int(low), 0), int(high) + 1) for low, high in zip(first_px, last_px, strict=True)
    )
    a, b = (np.ascontiguousarray(pictures.grey[f][part]) for f in (first, second))
    first_vertices, second_vertices = (
        pixels[f] - (part[1].start, part[0].start) for f in (first, second)
    )
    begun = _initial_flow(a.shape, first_vertices, second_vertices, visible[first])
    forward = dense_flow(search, a, b, begun)
    begun = _initial_flow(a.shape, second_vertices, first_vertices, visible[second])
    backward = dense_flow(search, b, a, begun)
    y, x = np.mgrid[: a.shape[0], : a.shape[1]].astype(np.float32)
    target = (x + forward[..., 0], y + forward[..., 1])
    returned = cv2.remap(backward, *target, cv2.INTER_LINEAR, borderValue=(1e4, 1e4))
    similar = np.less(cv2.absdiff(a, cv2.remap(b, *target, cv2.INTER_LINEAR)), _MAX_DIFFERENCE)
    error = np.linalg.norm(forward + returned, axis=-1)
    length = np.linalg.norm(forward, axis=-1)
    known = similar & np.asarray(error < _CONSISTENT_PX + _CONSISTENT_SHARE * length) & person[part]
    forward = np.asarray(forward) / np.float32(pictures.window.scale)
    flow[part] = np.where(known[..., None], forward, np.nan)
    return flow


def _initial_flow(shape: tuple[int, ...], start: Array, end: Array, visible: Array) -> Array:
    """Initial flow [h w 2]: that of the nearest visible vertex, zero where all are far."""
    height, width = shape
    cells = [-(-side // _GRID_PX) for side in shape]
    motion = np.empty((*cells, 2), np.float32)
    nearest_motion(start, end, visible, _GRID_PX, _INITIAL_FLOW_PX, motion)
    return cv2.resize(motion, (width, height), interpolation=cv2.INTER_LINEAR)


def certainty(grey: UInt8[Array, "h w"]) -> Float[Array, "h w 3"]:
    """xx, xy and yy of S (S + n 1)^-1, with S the structure tensor and n what noise makes of it.

    Nearly the unit matrix with texture, zero without; at an edge, the motion across it is known
    and the motion along it is not.
    """
    xx, xy, yy = structure_tensor(grey, _TEXTURE_PX)
    xx, yy, noise = xx + _NOISE**2, yy + _NOISE**2, _NOISE**2
    share = noise / (xx * yy - xy * xy)
    return np.stack([1.0 - share * yy, share * xy, 1.0 - share * xx], axis=-1).astype(np.float16)


def _unknown_flow(like: Array) -> Float[Array, "h w 2"]:
    return np.full((*like.shape, 2), np.nan, np.float16)


def _extend_person(grey: UInt8[Array, "h w"], person: Bool[Array, "h w"]) -> UInt8[Array, "h w"]:
    """Extends the person's colours to the pixels near them (nearest neighbour)."""
    if not person.any():
        return np.full(grey.shape, _BACKGROUND_GREY, np.uint8)
    distance, labels = cv2.distanceTransformWithLabels(
        1 - person.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    nearest = np.asarray(labels, dtype=np.int64)
    colours = np.zeros(nearest.max() + 1, np.uint8)
    colours[nearest[person]] = grey[person]
    return np.where(np.less(distance, _EXTENDED_PX), colours[nearest], np.uint8(_BACKGROUND_GREY))
