"""The person's mask: the estimator's soft one, its edge moved onto the picture's own edges.

The estimator sees the person in 256 pixels and its mask is that coarse. Inside a narrow band around
its edge the picture's colours decide (GrabCut, Rother et al. 2004), so that a wrong cut does little
harm; what is not connected with the person's skeleton (other people, furniture) is dropped.
"""

from __future__ import annotations

import cv2
import numpy as np

from capture.landmarks import Landmarks
from scene.arrays import Array, Float, UInt8

_SURE = 0.5
_CERTAIN = 0.97
"""Alpha from which the estimator is believed without a look at the colours."""
_BAND_SHARE = 90.0
"""The band's half width is the person's extent over this: about two of the estimator's pixels."""
_CUT_ROUNDS = 1
_FEWEST_PIXELS = 100
"""Of either side: colour models of fewer say nothing."""
_EDGE_BLUR_PX = 0.7
"""Turns the cut's hard edge into the soft one of a camera's pixels."""
_PERSON = (cv2.GC_FGD, cv2.GC_PR_FGD)
_BONES = ((11, 12), (11, 23), (12, 24), (23, 24), (11, 13), (13, 15), (12, 14), (14, 16), (23, 25),
          (25, 27), (24, 26), (26, 28), (0, 11), (0, 12))  # fmt: skip


def refine_mask(image: UInt8[Array, "H W 3"], person: Landmarks) -> Float[Array, "H W"]:
    """Soft alpha float32 in [0, 1] of `person` in `image`."""
    coarse = keep_connected(person.mask, person)
    extent = float((person.box[2:] - person.box[:2]).max())
    radius = int(np.clip(round(extent / _BAND_SHARE), 2, 10))
    rows, columns = _around(coarse, 6 * radius)
    alpha = np.zeros_like(coarse)
    if rows.stop > rows.start:
        cut = _cut(image[rows, columns], coarse[rows, columns], radius)
        alpha[rows, columns] = cv2.GaussianBlur(cut, (0, 0), _EDGE_BLUR_PX)
    return keep_connected(alpha, person)


def _cut(image: Array, coarse: Array, radius: int) -> Float[Array, "h w"]:
    """The mask cut anew, 0 or 1, within `radius` of its edge and where it is unsure."""
    solid = (coarse > _SURE).astype(np.uint8)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    labels = np.where(solid > 0, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[(cv2.erode(solid, kernel) > 0) | (coarse > _CERTAIN)] = cv2.GC_FGD
    labels[(cv2.dilate(solid, kernel) == 0) | (coarse < 1.0 - _CERTAIN)] = cv2.GC_BGD
    sides = [np.isin(labels, pair) for pair in (_PERSON, (cv2.GC_BGD, cv2.GC_PR_BGD))]
    if min(side.sum() for side in sides) < _FEWEST_PIXELS:
        return solid.astype(np.float32)
    cv2.setRNGSeed(0)  # its k-means starts at random: the same clip must give the same mask
    models = np.zeros((1, 65)), np.zeros((1, 65))
    pixels = np.ascontiguousarray(image[..., ::-1])
    cv2.grabCut(pixels, labels, (0, 0, 1, 1), *models, _CUT_ROUNDS, cv2.GC_INIT_WITH_MASK)
    return np.isin(labels, _PERSON).astype(np.float32)


def _around(mask: Array, margin: int) -> tuple[slice, slice]:
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
