"""Registers the pictures of a training to its model: takes out of them what no pose explains.

Cloth creases, hair swings, and poses are a little off. So each picture shows a print, a strand or
an outline a pixel or two from where the model has it, and the mean of all of them is a blur. The
model of half a training tells well enough where things belong: smooth optical flow
(`scene.dense_flow`) from its picture to the frame's moves what the frame shows there, as
photographs are registered to a scanned surface (Zhou and Koltun 2014).
"""

from __future__ import annotations

import numpy as np

from renderer.splats.training.views import View
from scene.arrays import Array, Float
from scene.dense_flow import dense_flow

_GRID = 64
"""Rows and columns of places of a picture whose flow is kept."""
_SMOOTH, _MOST = 0.02, 0.02
"""Deviation over which flow is smoothed, and how long it is at most: shares of the height."""
_LEAST = 0.0007
"""Share of the height from which flow counts: less is noise, and any is paid with sharpness."""
_RETURNS_PX = 1.0
"""Distance from where it began at which flow there and back must end, else it is not trusted."""
_STANDS_OUT = 0.1
"""Alpha of the model from which there is something to register to."""
_OVER = 0.5
"""Grey behind both, darker than light clothes and lighter than dark ones."""


def flow_to_frame(
    made: Float[Array, "H W 4"], truth: Float[Array, "H W 4"]
) -> Float[Array, "G G 2"]:
    """From what the model's picture `made` shows to where `truth`, the frame, shows it: right and
    down, at evenly spaced places, as a share of the height; float16. Both are premultiplied sRGB.
    """
    import cv2

    search, height = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM), len(made)
    one, other, nothing = _grey(made), _grey(truth), np.zeros((*made.shape[:2], 2), np.float32)
    flow = dense_flow(search, one, other, nothing.copy())
    back = _moved(dense_flow(search, other, one, nothing), flow, cv2.INTER_LINEAR)
    trust = np.hypot(cv2.Sobel(one, cv2.CV_32F, 1, 0), cv2.Sobel(one, cv2.CV_32F, 0, 1)) + 1.0
    trust[np.linalg.norm(flow + back, axis=2) > _RETURNS_PX] = 0.0
    trust[cv2.dilate(made[..., 3], np.ones((3, 3), np.uint8)) < _STANDS_OUT] = 0.0
    total, weight = (
        cv2.GaussianBlur(values, (0, 0), _SMOOTH * height)
        for values in (flow * trust[..., None], trust)
    )
    smooth = total / (weight[..., None] + 1.0) / height
    length = np.linalg.norm(smooth, axis=2, keepdims=True) + 1e-12
    smooth *= np.clip(length - _LEAST, 0.0, _MOST) / length
    return cv2.resize(smooth, (_GRID, _GRID), interpolation=cv2.INTER_AREA).astype(np.float16)


def registered(view: View, flow: Float[Array, "G G 2"]) -> View:
    """What `view`'s camera would have seen of the person where the model has them; `flow` as of
    `flow_to_frame`."""
    import cv2

    height, width = view.rgba.shape[:2]
    pixels = cv2.resize(flow.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    rgba = _moved(view.rgba, pixels * np.float32(height), cv2.INTER_CUBIC)
    # cubic weights overshoot, and colours are premultiplied
    rgba[..., :3] = np.minimum(rgba[..., :3], rgba[..., 3:])
    return View(rgba, view.window, view.camera)


def _moved(picture: Array, flow: Float[Array, "H W 2"], interpolation: int) -> Array:
    """At each place what `picture` shows where `flow` leads from there."""
    import cv2

    height, width = flow.shape[:2]
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    return cv2.remap(picture, x + flow[..., 0], y + flow[..., 1], interpolation)


def _grey(picture: Float[Array, "H W 4"]) -> Array:
    import cv2

    over = picture[..., :3] + _OVER * (1.0 - picture[..., 3:])
    luma = cv2.cvtColor(over, cv2.COLOR_RGB2GRAY)
    return (np.clip(luma, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
