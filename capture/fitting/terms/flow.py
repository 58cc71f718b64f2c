"""Optical flow: what moved from picture to picture is where the surface moved.

Landmarks tell where joints are, each frame with an error of its own; optical flow (DIS, Kroeger et
al. 2016, by OpenCV) tells how every seen place of skin and cloth moves between frames, finer than
any landmark and, for limbs that turn about themselves, what no landmark shows. Only differences of
frames enter, so it draws a clip together and moves nobody by itself. Plain places get whatever the
search fills them in with, so each is believed as far as its texture tells (`certainty`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
import torch.nn.functional as nnf

from capture.fitting.observations import Observations
from capture.fitting.robust import geman_mcclure
from capture.fitting.state import FitBody, PosedClip
from capture.fitting.term import Term
from capture.fitting.window import Window, window_around
from scene.arrays import Array, Bool, Float, Int, Tensor, UInt8

_STRIDES = (1, 3)
"""Frames between the two pictures of a pair: near ones move little, far ones drift less."""
_STRIDES_S = (1 / 15, 3 / 15)
"""They are so far apart at least: between two of sixty frames a second nothing has moved by more
than flow is off."""
_SIDE_PX = 448
"""Longest side of the window in which flow is found."""
_BEHIND = 128
"""Grey level in place of the room, which stands still."""
_GRID_PX = 8
_DESCENTS = 12
"""Iterations on every scale, down to the pictures' own. Refining between patches cost a third more
and brought no joint nearer."""
_REACH_PX = 25.0
"""How far from a seen vertex, px of the window, the search still begins with its motion."""
_RETURNS_PX, _RETURNS_SHARE = 1.0, 0.05
"""There and back may miss so many pixels, and so much of the way."""
_TEXTURE_PX, _NOISE = 4.0, 2.0
"""Deviation of the window in which texture counts, and its slope, grey levels a pixel, at which
motion across it is half believed."""
_ALIKE = 24
"""Grey levels that two places of a match may differ by."""
_ON_PERSON, _EDGE_PX = 0.9, 2
"""Alpha from which a pixel shows nothing but the person, and how far from others it must lie."""
_ROUND_PX = 24
"""Room kept round the person."""
_FILLED_PX = 24
"""How far the person's colours are drawn out over the room, which would hold edges back."""
_FACING = 0.35
"""Cosine between a vertex' normal and the way to the camera from which it is taken for seen."""
_IN_FRONT_M = 0.1
"""Vertices deeper than the nearest in their cell by more are hidden."""
_OUTLIER = 3.0
_FEW = 20.0
"""Seen vertices below which a pair of frames loses its say."""


_DEVIATION = 0.004
"""Of how far the surface moves between two pictures, in heights of the person."""
_CELL = 0.03
"""Side of a cell in which near vertices hide far ones, in heights of the person."""


class OpticalFlow(Term):
    """How far visible vertices miss the motion between pictures, where pictures were given."""

    weight = 120.0

    def __init__(self, body: FitBody, seen: Observations) -> None:
        super().__init__(body, seen)
        self._pictures = None if seen.images is None else Pictures(seen.images, seen.masks)
        self._flow: Flow | None = None
        self._targets: FlowTargets | None = None

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


class Pictures:
    """The person alone, grey, in all frames."""

    def __init__(
        self, images: Sequence[UInt8[Array, "H W 3"]], masks: Sequence[Float[Array, "H W"] | None]
    ) -> None:
        self.window = window_around(masks, _SIDE_PX)
        cut = [self._cut(image, mask) for image, mask in zip(images, masks, strict=True)]
        self.grey: list[UInt8[Array, "h w"]] = [grey for grey, _ in cut]
        self.person: list[Bool[Array, "h w"]] = [person for _, person in cut]
        self.certainty = torch.from_numpy(np.stack([certainty(grey) for grey in self.grey]))
        """Of each place's motion [F h w 3] (`certainty`)."""

    def _cut(self, image: Array, mask: Array | None) -> tuple[Array, Array]:
        grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
        grey = self.window.cut(grey)
        if mask is None:
            return np.full(grey.shape, _BEHIND, np.uint8), np.zeros(grey.shape, bool)
        person = self.window.cut(mask) > _ON_PERSON
        edge = cv2.erode(person.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=_EDGE_PX)
        return _without_room(grey, person), edge > 0


@dataclass(frozen=True, eq=False)
class Flow:
    """How far each place moves, px of the full picture, for every stride; NaN where unknown."""

    window: Window
    moved: dict[int, Float[Tensor, "pairs h w 2"]]
    certainty: Float[Tensor, "F h w 3"]
    """Of the motion from each frame on (`certainty`)."""

    def at(self, stride: int, pixels: Float[Tensor, "pairs V 2"]) -> Float[Tensor, "pairs V 2"]:
        """The motion at `pixels` of each pair's first picture; NaN outside and where unknown."""
        return self._look_up(self.moved[stride], pixels)

    def certainty_at(self, pixels: Float[Tensor, "F V 2"]) -> Float[Tensor, "F V 3"]:
        """How far the motion from there on is to be believed; NaN outside."""
        return self._look_up(self.certainty, pixels)

    def _look_up(
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
    long = zip(_STRIDES, _STRIDES_S, strict=True)
    return tuple(max(frames, round(apart_s / step_s)) for frames, apart_s in long)


def find_flow(
    pictures: Pictures,
    takes: Int[Array, "F"],
    strides: Sequence[int],
    pixels: Float[Array, "F V 2"],
    seen: Bool[Array, "F V"],
    *,
    coarse: bool = False,
) -> Flow:
    """Flow between frames of the same take, begun with the motion of the fit's `seen` vertices.

    `strides` are those of `strides_of`; `pixels` is where the vertices are in the full picture.
    `coarse` stops at half the resolution, for motions that are still off by more. Where the way
    there and back does not return, something was hidden or mistaken: nothing is known there.
    """
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    search.setFinestScale(int(coarse))
    search.setGradientDescentIterations(_DESCENTS)
    search.setVariationalRefinementIterations(0)
    inside = pictures.window.inside(pixels.astype(np.float32))
    moved: dict[int, Tensor] = {}
    for stride in (s for s in strides if s < len(pictures.grey)):
        pairs = [
            _between(search, pictures, first, first + stride, inside, seen)
            if takes[first] == takes[first + stride]
            else _unknown(pictures.grey[first])
            for first in range(len(pictures.grey) - stride)
        ]
        moved[stride] = torch.from_numpy(np.stack(pairs))
    return Flow(pictures.window, moved, pictures.certainty)


def visible_vertices(
    surface: Float[Tensor, "F V 3"],
    pixels: Float[Tensor, "F V 2"],
    normals: Float[Tensor, "F V 3"],
    cell_px: float,
) -> Bool[Tensor, "F V"]:
    """Vertices that face the camera (at the origin) with nothing before them in their cell."""
    facing = (normals * nnf.normalize(-surface, dim=-1)).sum(-1) > _FACING
    depth = -surface[..., 2]
    cells = (pixels / cell_px).long().clamp(-(2**14), 2**14) + 2**14
    frame = torch.arange(len(surface))[:, None] * 2**32
    _, cell = torch.unique(frame + cells[..., 1] * 2**16 + cells[..., 0], return_inverse=True)
    nearest = torch.full((int(cell.max()) + 1,), torch.inf)
    nearest = nearest.scatter_reduce(0, cell.flatten(), depth.flatten(), "amin")
    return facing & (depth < nearest[cell] + _IN_FRONT_M)


@dataclass(frozen=True, eq=False)
class FlowTargets:
    """How far the flow says that vertices move, as last looked up."""

    moved: dict[int, Float[Tensor, "pairs V 2"]]
    trusted: dict[int, Float[Tensor, "pairs V"]]
    certainty: dict[int, Float[Tensor, "pairs V 3"]]


def flow_targets(
    flow: Flow, pixels: Float[Tensor, "F V 2"], seen: Bool[Tensor, "F V"]
) -> FlowTargets:
    """The flow at the vertices' present places, trusted where both frames show them."""
    targets, sure = FlowTargets({}, {}, {}), flow.certainty_at(pixels)
    for stride in flow.moved:
        moved = flow.at(stride, pixels[:-stride])
        known = torch.isfinite(moved[..., 0]) & seen[:-stride] & seen[stride:]
        targets.trusted[stride] = known.float()
        targets.moved[stride] = torch.where(known[..., None], moved, 0.0)
        targets.certainty[stride] = torch.where(known[..., None], sure[:-stride], 0.0)
    return targets


def flow_energy(
    targets: FlowTargets, pixels: Float[Tensor, "F V 2"], deviation_px: float
) -> Tensor:
    """Mean over pairs, strides and seen vertices of how far these miss the flow, as far as its
    certainty goes."""
    total = pixels.new_zeros(())
    for stride, moved in targets.moved.items():
        off = (pixels[stride:] - pixels[:-stride] - moved) / deviation_px
        trusted = targets.trusted[stride]
        (x, y), (xx, xy, yy) = off.unbind(-1), targets.certainty[stride].unbind(-1)
        squared = xx * x * x + 2.0 * xy * x * y + yy * y * y
        missed = (geman_mcclure(squared, _OUTLIER) * trusted).sum(1)
        total = total + (missed / (trusted.sum(1) + _FEW)).mean()
    return total / max(len(targets.moved), 1)


def _between(
    search: cv2.DISOpticalFlow,
    pictures: Pictures,
    first: int,
    second: int,
    pixels: Array,
    seen: Array,
) -> Float[Array, "h w 2"]:
    """Flow where the two pictures show the person, whom it is sought round."""
    person = pictures.person[first]
    flow = _unknown(person)
    shown = np.argwhere(person | pictures.person[second])
    if not len(shown):
        return flow
    first_px, last_px = shown.min(axis=0) - _ROUND_PX, shown.max(axis=0) + _ROUND_PX
    part = tuple(
        slice(max(int(low), 0), int(high) + 1) for low, high in zip(first_px, last_px, strict=True)
    )
    a, b = (np.ascontiguousarray(pictures.grey[f][part]) for f in (first, second))
    before, after = (pixels[f] - (part[1].start, part[0].start) for f in (first, second))
    there = search.calc(a, b, _begun(a.shape, before, after, seen[first]))
    back = search.calc(b, a, _begun(a.shape, after, before, seen[second]))
    y, x = np.mgrid[: a.shape[0], : a.shape[1]].astype(np.float32)
    arrived = (x + there[..., 0], y + there[..., 1])
    returned = cv2.remap(back, *arrived, cv2.INTER_LINEAR, borderValue=(1e4, 1e4))
    alike = np.less(cv2.absdiff(a, cv2.remap(b, *arrived, cv2.INTER_LINEAR)), _ALIKE)
    missed = np.linalg.norm(there + returned, axis=-1)
    way = np.linalg.norm(there, axis=-1)
    known = alike & np.asarray(missed < _RETURNS_PX + _RETURNS_SHARE * way) & person[part]
    there = np.asarray(there) / np.float32(pictures.window.scale)
    flow[part] = np.where(known[..., None], there, np.nan)
    return flow


def _begun(shape: tuple[int, ...], here: Array, there: Array, seen: Array) -> Array:
    """Flow [h w 2] of the nearest seen vertex, none where all are far."""
    height, width = shape
    if not seen.any():
        return np.zeros((height, width, 2), np.float32)
    half = _GRID_PX // 2
    y, x = np.mgrid[half : height + half : _GRID_PX, half : width + half : _GRID_PX]
    grid = np.stack([x, y], axis=-1).astype(np.float32)
    apart = np.linalg.norm(grid[:, :, None] - here[seen], axis=-1)
    begun = (there - here)[seen][apart.argmin(axis=-1)]
    begun[apart.min(axis=-1) > _REACH_PX] = 0.0
    return cv2.resize(begun.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)


def certainty(grey: UInt8[Array, "h w"]) -> Float[Array, "h w 3"]:
    """xx, xy and yy of S (S + n 1)^-1, with S the structure tensor (Foerstner & Guelch 1987) and n
    what noise makes of it.

    Where there is texture nearly the unit matrix, in plain places nil; along an edge, what moves
    across it is known and what moves along it is not.
    """
    x, y = (cv2.Sobel(grey, cv2.CV_32F, 1 - down, down, scale=0.125) for down in (0, 1))
    xx, xy, yy = (
        cv2.GaussianBlur(product, (0, 0), _TEXTURE_PX) for product in (x * x, x * y, y * y)
    )
    xx, yy, noise = xx + _NOISE**2, yy + _NOISE**2, _NOISE**2
    share = noise / (xx * yy - xy * xy)
    return np.stack([1.0 - share * yy, share * xy, 1.0 - share * xx], axis=-1).astype(np.float16)


def _unknown(like: Array) -> Float[Array, "h w 2"]:
    return np.full((*like.shape, 2), np.nan, np.float16)


def _without_room(grey: UInt8[Array, "h w"], person: Bool[Array, "h w"]) -> UInt8[Array, "h w"]:
    """Each pixel near the person with the colour of the person's nearest."""
    if not person.any():
        return np.full(grey.shape, _BEHIND, np.uint8)
    away, labels = cv2.distanceTransformWithLabels(
        1 - person.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    nearest = np.asarray(labels, dtype=np.int64)
    colours = np.zeros(nearest.max() + 1, np.uint8)
    colours[nearest[person]] = grey[person]
    return np.where(np.less(away, _FILLED_PX), colours[nearest], np.uint8(_BEHIND))
