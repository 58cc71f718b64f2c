"""A contact sheet of an evaluation: truth, model and error of every view side by side, as sRGB.

Three cells a view, cut to a square round the body. Errors are the mean over channels of the
absolute difference, through black, red, yellow and white; white is 0.25 and more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch.nn import functional

from renderer.evaluation.evaluate import EvaluatedView
from renderer.evaluation.metrics import psnr
from scene.arrays import Array, Float
from scene.errors import InvalidInput

CELL_PX, CAPTION_PX = 160, 20
"""Side of a cell, and the band above it that a caption fits in."""
_GAP_PX = 8
_VIEWS_A_ROW = 4
_WHITE_AT = 0.25
_PAPER = 0.12
"""Grey between the cells."""


@dataclass(frozen=True)
class Label:
    """Words for a view; whoever can draw letters puts them there."""

    x: int
    """px of the text's left edge."""
    y: int
    """px of its baseline."""
    text: str


def contact_sheet(views: list[EvaluatedView]) -> tuple[Float[Array, "H W 3"], list[Label]]:
    """The sheet of `views`, row by row, and their captions. Raises InvalidInput where none is."""
    if not views:
        raise InvalidInput("a contact sheet must show at least one view; got none")
    columns = min(_VIEWS_A_ROW, len(views))
    rows = -(-len(views) // columns)
    step_y, step_x = CAPTION_PX + CELL_PX + _GAP_PX, 3 * CELL_PX + _GAP_PX
    shape = (rows * step_y + _GAP_PX, columns * step_x + _GAP_PX, 3)
    sheet, captions = np.full(shape, _PAPER, np.float32), []
    for place, view in enumerate(views):
        top, left = (
            _GAP_PX + n * s for n, s in zip(divmod(place, columns), (step_y, step_x), strict=True)
        )
        crop = view.crop or (slice(None), slice(None))
        decibels = min(psnr(view.made[crop], view.truth[crop]), 100.0)
        name = view.split.replace("_", " ")
        captions.append(
            Label(left, top + CAPTION_PX - 6, f"{name} {view.index}: {decibels:.1f} dB")
        )
        error = error_colours(np.abs(view.made - view.truth).mean(axis=-1))
        for cell, picture in enumerate((view.truth, view.made, error)):
            at = (
                slice(top + CAPTION_PX, top + CAPTION_PX + CELL_PX),
                slice(left + cell * CELL_PX, left + (cell + 1) * CELL_PX),
            )
            sheet[at] = _fitted(picture, crop)
    return sheet, captions


def error_colours(error: Float[Array, "H W"]) -> Float[Array, "H W 3"]:
    """Black where there is none, then red, yellow, white at 0.25."""
    level = 3.0 * error[..., None] / _WHITE_AT
    return np.clip(level - np.arange(3.0), 0.0, 1.0).astype(np.float32)


def _fitted(picture: Float[Array, "H W 3"], crop: tuple[slice, slice]) -> Float[Array, "_ _ 3"]:
    """The crop in the middle of a black square, resized to a cell."""
    cut = picture[crop]
    side = max(cut.shape[:2])
    square = np.zeros((side, side, 3), np.float32)
    top, left = ((side - length) // 2 for length in cut.shape[:2])
    square[top : top + cut.shape[0], left : left + cut.shape[1]] = cut
    tensor = torch.from_numpy(square).movedim(-1, 0)[None]
    cell = functional.interpolate(
        tensor, (CELL_PX, CELL_PX), mode="bilinear", antialias=True, align_corners=False
    )
    return np.clip(cell[0].movedim(0, -1).numpy(), 0.0, 1.0)
