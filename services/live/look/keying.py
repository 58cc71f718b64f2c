"""A person on black, as live look sends them: lifted off it, so that the picture is its own matte.

A matte beside the picture costs a quarter of its bits, and to be cheap it must be small, with rough
edges. The page's twins are client/src/look/cutOut.ts and client/src/recolouring/pictureReader.ts.
"""

from __future__ import annotations

import cv2
import numpy as np

from scene.arrays import Array, Float, UInt8

LIFT = 36
"""The darkest that a person is, of 255."""
_BLACK, _PERSON = 12, 28
"""Luma that counts as none of the person, and as nothing else: coding leaves some noise on
black."""
_LEVELS = np.arange(256, dtype=np.float32)
_LOWERED = (np.clip((_LEVELS - LIFT) / (1.0 - LIFT / 255.0), 0.0, 255.0) + 0.5).astype(np.uint8)
_MATTE = (255.0 * np.clip((_LEVELS - _BLACK) / (_PERSON - _BLACK), 0.0, 1.0) + 0.5).astype(np.uint8)
"""Of each level, and of each luma."""


def lifted(rgb: UInt8[Array, "H W 3"], kept: Float[Array, "H W"]) -> UInt8[Array, "H W 3"]:
    """What to send of a picture, of which `kept` (0 to 1) is the person."""
    person = LIFT + (1.0 - LIFT / 255.0) * rgb.astype(np.float32)
    return (person * kept[..., None] + 0.5).astype(np.uint8)


def lowered(sent: UInt8[Array, "H W 3"]) -> tuple[UInt8[Array, "H W 3"], UInt8[Array, "H W"]]:
    """The person's colours, and their matte."""
    # BT.601
    luma = np.asarray(cv2.cvtColor(np.ascontiguousarray(sent), cv2.COLOR_RGB2GRAY), np.uint8)
    rgb, matte = cv2.LUT(sent, _LOWERED), cv2.LUT(luma, _MATTE)
    return np.asarray(rgb, np.uint8), np.asarray(matte, np.uint8)
