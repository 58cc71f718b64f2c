"""The person's mask: the estimator's soft one, its edge moved onto the picture's own edges.

The estimator sees the person in 256 pixels and its mask is that coarse. Inside a narrow band around
its edge the picture's colours decide (GrabCut, Rother et al. 2004), which bounds the harm of wrong
cuts; where the colours of both sides differ, edge pixels get the alpha that explains their mixture.
With a still camera the background is known (`capture.segmentation.background`), which restores
hands and feet that the estimator missed. Parts that are not connected with the person's skeleton
(other people, furniture) are dropped. Last, static pixels are averaged over neighbouring frames.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from capture.detection.landmarks import Landmarks
from capture.segmentation.background import BackgroundModel
from scene.arrays import Array, Bool, Float, UInt8

_THRESHOLD = 0.5
_CERTAIN = 0.97
"""Alpha from which the estimator's label is final."""
_BAND_SHARE = 90.0
"""The band's half width is the person's extent over this: about two of the estimator's pixels."""
_REACH = 3
"""Half widths of the band within which a known background may extend the mask."""
_MIN_PIXELS = 100
"""Of either side: too few for colour models."""
_STRIDE = 3
"""px between those that colour models are learnt from, where enough are left: two thirds of the
time, for an edge that is as good."""
_EDGE_BLUR_PX = 0.7
"""Turns the cut's hard edge into the soft one of a camera's pixels."""
_EDGE_RADIUS = 2
"""px around an edge pixel from which the colours of both sides are averaged."""
_CONTRAST = 60.0
"""Difference of both sides' colours, levels of 255, at which the matte counts half."""
_UNCHANGED = 2.0
"""Squared deviations above noise at which a pixel's neighbour in time counts 1 / e."""
_NOISE = 3.0
"""Levels of 255 by which a pixel that does not move may change between frames."""
_PERSON = (cv2.GC_FGD, cv2.GC_PR_FGD)
_NO_RECT = (0, 0, 1, 1)
"""The labels tell it."""
_BONES = ((11, 12), (11, 23), (12, 24), (23, 24), (11, 13), (13, 15), (12, 14), (14, 16), (23, 25),
          (25, 27), (24, 26), (26, 28), (0, 11), (0, 12))  # fmt: skip
_HAND_AND_FOOT_BONES = (
    (15, 17), (15, 19), (16, 18), (16, 20),
    (27, 29), (29, 31), (27, 31), (28, 30), (30, 32), (28, 32),
)  # fmt: skip
"""Hands and feet: often missing from the estimator's mask."""


def refine_mask(
    image: UInt8[Array, "H W 3"], person: Landmarks, background: BackgroundModel | None = None
) -> Float[Array, "H W"]:
    """Soft alpha float32 in [0, 1] of `person` in `image`, in front of `background`."""
    coarse = keep_connected(person.mask, person)
    radius = _band(person)
    alpha = np.zeros_like(coarse)
    if not (coarse > 0.05).any():
        return alpha
    bones = draw_bones(person, coarse.shape, 2 * radius)
    rows, columns = _window_around(
        coarse if background is None else np.maximum(coarse, bones), 6 * radius
    )
    window, labels = image[rows, columns], _labels(coarse[rows, columns], radius)
    if background is not None:
        foreground, known_background = background.classify(window, rows, columns)
        _apply_background_labels(labels, foreground, known_background, bones[rows, columns], radius)
    soft = cv2.GaussianBlur(_grab_cut(window, labels), (0, 0), _EDGE_BLUR_PX)
    alpha[rows, columns] = _matted(window, soft)
    return keep_connected(alpha, person)


def smooth_masks(
    images: Sequence[UInt8[Array, "H W 3"]], masks: Sequence[Float[Array, "H W"] | None]
) -> list[Float[Array, "H W"] | None]:
    """Masks averaged with their neighbours in time wherever the picture is static.

    An edge that moves keeps its place; one that stands still no longer flickers.
    """
    smoothed: list[Float[Array, "H W"] | None] = []
    for index, mask in enumerate(masks):
        near = [i for i in (index - 1, index + 1) if 0 <= i < len(masks)]
        others = [(images[i], other) for i in near if (other := masks[i]) is not None]
        smoothed.append(None if mask is None else _temporal_average(images[index], mask, others))
    return smoothed


def mask_bounds(
    masks: Sequence[Float[Array, "H W"] | None], above: float, margin_share: float
) -> tuple[int, int, int, int] | None:
    """x, y, width, height, px, of what holds all masks where they are `above`, with a margin.

    `margin_share` is of the person's longer side. None where all masks are empty.
    """
    union = np.max([mask > above for mask in masks if mask is not None], axis=0)
    rows, columns = np.flatnonzero(union.any(axis=1)), np.flatnonzero(union.any(axis=0))
    if not len(rows):
        return None
    margin = math.ceil(margin_share * max(len(rows), len(columns)))
    x, y = max(0, int(columns[0]) - margin), max(0, int(rows[0]) - margin)
    height, width = union.shape
    right, below = int(columns[-1]) + 1 + margin, int(rows[-1]) + 1 + margin
    return x, y, min(width, right) - x, min(height, below) - y


def dilated_person_mask(person: Landmarks) -> UInt8[Array, "H W"]:
    """1 wherever `person` could be; 0 where the background is certainly visible."""
    radius = _band(person)
    covered = (person.mask > 0.1).astype(np.uint8) | draw_bones(person, person.mask.shape, 1)
    return cv2.dilate(covered, np.ones((4 * radius + 1,) * 2, np.uint8))


def _band(person: Landmarks) -> int:
    """Half the width, px, of the band around the estimator's edge in which colours decide."""
    extent = float((person.box[2:] - person.box[:2]).max())
    return int(np.clip(round(extent / _BAND_SHARE), 2, 10))


def _labels(coarse: Array, radius: int) -> UInt8[Array, "h w"]:
    """What the cut may change: pixels within `radius` of the edge, and where it is unsure."""
    solid = (coarse > _THRESHOLD).astype(np.uint8)
    labels = np.where(solid > 0, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[(cv2.erode(solid, _disc(radius)) > 0) | (coarse > _CERTAIN)] = cv2.GC_FGD
    labels[(cv2.dilate(solid, _disc(radius)) == 0) | (coarse < 1.0 - _CERTAIN)] = cv2.GC_BGD
    return labels


def _apply_background_labels(
    labels: Array,
    foreground: Bool[Array, "h w"],
    known_background: Bool[Array, "h w"],
    bones: Array,
    radius: int,
) -> None:
    """Mark the background in the band, and the person up to `_REACH` bands away."""
    certain, certain_background = labels == cv2.GC_FGD, labels == cv2.GC_BGD
    person = np.isin(labels, _PERSON).astype(np.uint8) | bones
    found = foreground & ~certain & (cv2.dilate(person, _disc(_REACH * radius)) > 0)
    _, parts = cv2.connectedComponents((found | certain).astype(np.uint8))
    attached = np.zeros(int(parts.max()) + 1, bool)
    attached[parts[certain | (bones > 0)]] = True
    found &= attached[parts]
    labels[known_background & ~certain & ~certain_background] = cv2.GC_BGD
    labels[found] = cv2.GC_FGD
    rim = cv2.dilate(found.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    labels[rim & certain_background & ~found] = cv2.GC_PR_BGD  # the edge itself is left to the cut


def _grab_cut(image: Array, labels: Array) -> Float[Array, "h w"]:
    """Binary mask [h w] of GrabCut (Rother et al. 2004), 0 or 1."""
    solid = np.isin(labels, _PERSON)
    fewest = min(solid.sum(), (~solid).sum())
    if fewest < _MIN_PIXELS:
        return solid.astype(np.float32)
    stride = min(_STRIDE, math.isqrt(int(fewest) // _MIN_PIXELS))
    cv2.setRNGSeed(0)  # its k-means starts at random: the same clip must give the same mask
    models = np.zeros((1, 65)), np.zeros((1, 65))
    pixels = np.ascontiguousarray(image[..., ::-1])
    few, known = (np.ascontiguousarray(one[::stride, ::stride]) for one in (pixels, labels))
    cv2.grabCut(few, known, _NO_RECT, *models, 1, cv2.GC_INIT_WITH_MASK)
    cv2.grabCut(pixels, labels, _NO_RECT, *models, 1, cv2.GC_EVAL_FREEZE_MODEL)
    return np.isin(labels, _PERSON).astype(np.float32)


def _matted(image: Array, soft: Array) -> Float[Array, "h w"]:
    """Alpha of the edge's pixels from where their colour lies between the two sides' own.

    a = (I - B)(F - B) / |F - B|^2, trusted as far as the sides differ.
    """
    seen = image.astype(np.float32)
    sides = [(soft > 0.95).astype(np.float32), (soft < 0.05).astype(np.float32)]
    (person, inside), (behind, outside) = (_local_mean_colour(seen, side) for side in sides)
    apart = person - behind
    contrast = cv2.transform(apart * apart, np.ones((1, 3), np.float32))
    along = cv2.transform((seen - behind) * apart, np.ones((1, 3), np.float32))
    share = np.clip(along / (contrast + 1e-3), 0.0, 1.0)
    trust = contrast / (contrast + _CONTRAST**2)
    trust *= (soft > 0.02) & (soft < 0.98) & (inside > 1e-3) & (outside > 1e-3)
    return soft + trust * (share - soft)


def _local_mean_colour(seen: Array, side: Array) -> tuple[Array, Array]:
    """Mean colour of one side around each pixel, and how much of the window is that side."""
    window = (2 * _EDGE_RADIUS + 1,) * 2
    weight = cv2.blur(side, window)
    return cv2.blur(seen * side[..., None], window) / (weight[..., None] + 1e-4), weight


def _temporal_average(image: Array, mask: Array, others: Sequence[tuple[Array, Array]]) -> Array:
    """`mask`, averaged with `others` by how little the picture changed there."""
    edges = np.max([mask, *(other for _, other in others)], axis=0)
    rows, columns = _window_around(edges, 0)
    if rows.stop <= rows.start:
        return mask
    window = (rows, columns)
    here = image[window]
    total, weight = mask[window].copy(), np.ones_like(mask[window])
    for picture, other in others:
        change = cv2.absdiff(picture[window], here).astype(np.float32)
        squares = cv2.transform(change * change, np.ones((1, 3), np.float32))
        excess = cv2.blur(squares, (3, 3)) / (6.0 * _NOISE**2) - 1.0
        same = cv2.exp(np.maximum(excess, 0.0) / -_UNCHANGED)
        total += same * other[window]
        weight += same
    smoothed = mask.copy()
    smoothed[window] = total / weight
    return smoothed


def _disc(radius: int) -> Array:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))


def _window_around(mask: Array, margin: int) -> tuple[slice, slice]:
    """Rows and columns that hold the mask and `margin` pixels more; empty for an empty mask."""
    spans = []
    for axis, side in ((1, mask.shape[0]), (0, mask.shape[1])):
        found = np.flatnonzero((mask > 0.05).any(axis=axis))
        low, high = (int(found[0]), int(found[-1]) + 1) if len(found) else (0, 0)
        spans.append(slice(max(0, low - margin), min(side, high + margin) if high else 0))
    return spans[0], spans[1]


def keep_connected(mask: Float[Array, "H W"], person: Landmarks) -> Float[Array, "H W"]:
    """`mask` without the parts that no seen bone of `person` touches."""
    count, labels = cv2.connectedComponents((mask > 0.25).astype(np.uint8))
    if count <= 2:
        return mask.astype(np.float32)
    points = bone_points(person)
    x, y = points.astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < mask.shape[1]) & (y < mask.shape[0])
    touched = np.bincount(labels[y[inside], x[inside]], minlength=count)
    sizes = np.bincount(labels.ravel(), minlength=count)
    touched[0] = sizes[0] = 0
    if not touched.any():
        touched[np.argmax(sizes)] = 1
    keep = touched > 0
    keep[0] = True  # faint pixels around the parts that stay
    return np.where(np.take(keep, np.asarray(labels, dtype=np.int64)), mask, 0.0).astype(np.float32)


def bone_points(person: Landmarks, steps: int = 12) -> Float[Array, "P 2"]:
    """Points along the person's seen bones, px."""
    along = np.linspace(0.0, 1.0, steps)[:, None]
    points = [person.pixels[:1]]
    for start, end in _BONES:
        if min(person.visibility[start], person.visibility[end]) > 0.5:
            points.append(person.pixels[start] * (1.0 - along) + person.pixels[end] * along)
    return np.concatenate(points)


def draw_bones(person: Landmarks, shape: tuple[int, ...], width: int) -> UInt8[Array, "H W"]:
    """1 along the seen bones, hands and feet too, drawn `width` px wide."""
    drawn = np.zeros(shape, np.uint8)
    points = np.clip(person.pixels, -4000, 8000).astype(int).tolist()
    for start, end in _BONES + _HAND_AND_FOOT_BONES:
        if min(person.visibility[start], person.visibility[end]) > 0.5:
            cv2.line(drawn, points[start], points[end], 1, width)
    return drawn
