"""Draws a training's splats as a frame shows them."""

from __future__ import annotations

import numpy as np

from renderer.relighting.captured_light import CapturedLight
from renderer.splats.layout import BOX_FILTER_PX2
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.training.trained_splats import TrainedSplats
from renderer.splats.training.views import View
from scene.arrays import Array, Float, Int
from scene.camera import Camera

_PREVIEW_PX = 384
_LIGHT_GREY = np.float32(0.93)


def arrange(
    splats: TrainedSplats,
    light: CapturedLight | None,
    frame: int,
    view: View,
    transforms: Float[Array, "K 4 4"],
) -> tuple[Float[Array, "N P"], Float[Array, "N P"]]:
    """Project `splats` as `view` of `frame` shows them, into their workspace.

    Returns the parameters as expressions and cloth have moved them, and these shaded by the light.
    """
    height, width = view.rgba.shape[:2]
    shown = moved = splats.expressions.moved(splats.parameters, frame)
    if light is not None:
        eye = view.window.position
        shown = light.shade(moved, splats.joints, splats.weights, transforms, eye)
    splats.work.arrange(
        shown,
        splats.joints,
        splats.weights,
        transforms,
        view.camera,
        width,
        height,
        BOX_FILTER_PX2,
    )
    return moved, shown


def compare(
    splats: TrainedSplats,
    view: View,
    background: Float[Array, "3"],
    linear_from: float,
    losses: Float[Array, "_"],
) -> None:
    """Draw what was arranged over `background`, and compare it to `view`: fills the gradients of
    projected splats, and each thread's part of the losses."""
    from renderer.splats.rasteriser.tile_kernels import draw_and_differentiate
    from renderer.splats.training.adam_kernels import sum_threads

    work = splats.work
    draw_and_differentiate(
        work.projected,
        work.starts,
        work.entries,
        view.rgba,
        background,
        linear_from,
        splats.thread_gradients,
        losses,
    )
    sum_threads(splats.thread_gradients, splats.by_projected)


def picture(splats: TrainedSplats, view: View, threads: int) -> Float[Array, "H W 4"]:
    """What was arranged, premultiplied sRGB."""
    from renderer.splats.rasteriser.tile_kernels import draw

    drawn, work = np.empty(view.rgba.shape, np.float32), splats.work
    draw(work.projected, work.starts, work.entries, threads, drawn)
    return drawn


def truth(view: View) -> Float[Array, "H W 4"]:
    """What it shows, premultiplied sRGB."""
    return view.rgba.astype(np.float32) / np.float32(255.0)


def front(
    splats: TrainedSplats, frame: int, view: View, transforms: Float[Array, "K 4 4"]
) -> Int[Array, "H W"]:
    """Which of `splats` each pixel of `view` shows in `frame`; -1 where none does."""
    moved = splats.expressions.moved(splats.parameters, frame)
    return splats.work.front(
        moved, splats.joints, splats.weights, transforms, view.window, BOX_FILTER_PX2
    )


def preview(
    model: SplatModel,
    camera: Camera,
    transforms: Float[Array, "K 4 4"],
    expression: Float[Array, "E"],
    hung: Float[Array, "V 3"] | None,
) -> Float[Array, "H W 3"]:
    """What a small `camera` sees of `model`, over light grey.

    Args:
        hung: how its loose clothes hang; None without any.
    """
    scale = _PREVIEW_PX / max(camera.width, camera.height)
    small = camera.resized(round(camera.width * scale), round(camera.height * scale))
    seen = SplatRenderer((model,)).render(
        small, [transforms], expressions=[expression], hung=[hung]
    )
    return seen[..., :3] + (1.0 - seen[..., 3:]) * _LIGHT_GREY
