"""The person's mask: the estimator's soft one, its edge moved onto the picture's own edges.

The estimator sees the person in 256 pixels and its mask is that coarse. A guided filter (He et al.
2010) lets the picture's colours decide inside a narrow band around the edge; what is not connected
with the person's skeleton (other people, furniture) is dropped.
"""

from __future__ import annotations

import cv2
import numpy as np

from capture.landmarks import Landmarks
from scene.arrays import Array, Float, UInt8

_SURE = 0.5
_SHARPEN = 4.0
"""Slope of alpha around one half after filtering: an edge two or three pixels wide stays."""
_BONES = ((11, 12), (11, 23), (12, 24), (23, 24), (11, 13), (13, 15), (12, 14), (14, 16), (23, 25),
          (25, 27), (24, 26), (26, 28), (0, 11), (0, 12))  # fmt: skip


def refine_mask(image: UInt8[Array, "H W 3"], person: Landmarks) -> Float[Array, "H W"]:
    """Soft alpha float32 in [0, 1] of `person` in `image`."""
    coarse = keep_connected(person.mask, person)
    extent = float((person.box[2:] - person.box[:2]).max())
    radius = int(np.clip(round(extent / 80.0), 2, 12))
    rows, columns = _around(coarse, 4 * radius)
    alpha = np.zeros_like(coarse)
    if rows.stop > rows.start:
        alpha[rows, columns] = _sharpened(image[rows, columns], coarse[rows, columns], radius)
    return keep_connected(alpha, person)


def _sharpened(image: Array, coarse: Array, radius: int) -> Array:
    guide = image.astype(np.float32) / np.float32(255.0)
    source = np.ascontiguousarray(coarse)
    filtered = cv2.ximgproc.guidedFilter(guide=guide, src=source, radius=radius, eps=1e-4)
    sharp = np.clip((filtered - 0.5) * _SHARPEN + 0.5, 0.0, 1.0)
    band = edge_band(source, 2 * radius)
    return np.where(band, sharp, source > _SURE).astype(np.float32)


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
    return np.where(keep[np.asarray(labels)], mask, 0.0).astype(np.float32)


def bone_points(person: Landmarks, steps: int = 12) -> Float[Array, "P 2"]:
    """Points along the person's seen bones, px."""
    along = np.linspace(0.0, 1.0, steps)[:, None]
    points = [person.pixels[:1]]
    for start, end in _BONES:
        if min(person.visibility[start], person.visibility[end]) > 0.5:
            points.append(person.pixels[start] * (1.0 - along) + person.pixels[end] * along)
    return np.concatenate(points)


def edge_band(mask: Float[Array, "H W"], radius: int) -> Array:
    """Pixels within `radius` of the mask's edge, or where it is unsure; bool [H W]."""
    solid = (mask > _SURE).astype(np.uint8)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    near = cv2.dilate(solid, kernel) != cv2.erode(solid, kernel)
    return near | ((mask > 0.1) & (mask < 0.9) & (cv2.dilate(solid, kernel) > 0))
