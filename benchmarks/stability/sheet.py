"""The worst pictures of all: what training saw, the truth, and the model there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.reporting.cells import in_a_cell
from benchmarks.stability.judge import JudgedPicture
from scene.arrays import Array, UInt8
from scene.sequence import Frame, body_crop

_CELL_PX = 200, 120
_CAPTION_PX = 30
_STRIPS_A_ROW = 4
_GAP_PX = 6
_QUALITY = 88


@dataclass(frozen=True)
class WorstPicture:
    """A strip that a measurement left, and what is written above it."""

    strip: Path
    words: tuple[str, str]
    lpips: float


def write_strip(path: Path, trained: Frame, worst: JudgedPicture) -> None:
    """One frame that training saw, the truth of the worst view, and the model there."""
    crop = body_crop(trained.mask) or (slice(None), slice(None))
    cells = [in_a_cell(picture, _CELL_PX) for picture in
             (trained.image[crop], worst.truth, worst.rendered)]  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    strip = np.clip(255.0 * np.concatenate(cells, axis=1) + 0.5, 0, 255).astype(np.uint8)
    cv2.imwrite(str(path), strip[..., ::-1])


def draw_sheet(path: Path, worst: list[WorstPicture]) -> None:
    """Strips with their captions, the worst first. Nothing where there is none."""
    tiles = [tile for one in worst if (tile := _tile(one)) is not None]
    if not tiles:
        return
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % _STRIPS_A_ROW)
    rows = [
        np.concatenate(tiles[first : first + _STRIPS_A_ROW], axis=1)
        for first in range(0, len(tiles), _STRIPS_A_ROW)
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.concatenate(rows), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])


def _tile(one: WorstPicture) -> UInt8[Array, "H W 3"] | None:
    strip = cv2.imread(str(one.strip), cv2.IMREAD_COLOR)
    if strip is None:
        return None
    head = np.full((_CAPTION_PX, strip.shape[1], 3), 255, np.uint8)
    for line, text in enumerate(one.words):
        place = (2, 12 + 14 * line)
        cv2.putText(head, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    tile = np.concatenate([head, strip.astype(np.uint8)])
    return np.pad(tile, ((0, _GAP_PX), (0, _GAP_PX), (0, 0)), constant_values=255)
