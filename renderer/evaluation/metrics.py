"""How close a picture is to the truth: PSNR and SSIM on sRGB values in [0, 1], data range 1."""

from __future__ import annotations

import numpy as np
import torch
from torch.nn import functional

from scene.arrays import Array, Float
from scene.errors import InvalidInput

_SIGMA_PX = 1.5
_WINDOW_PX = 11
_K1, _K2 = 0.01, 0.03
_BLACK = 1.5 / 255.0
"""Mean of the pixels outside the mask below which a picture counts as already over black."""


def psnr(made: Float[Array, "H W 3"], truth: Float[Array, "H W 3"]) -> float:
    """Peak signal-to-noise ratio, dB; infinity for equal pictures."""
    _require_alike(made, truth)
    error = float(np.mean((made.astype(np.float64) - truth) ** 2))
    return float("inf") if error == 0.0 else -10.0 * float(np.log10(error))


def ssim(made: Float[Array, "H W 3"], truth: Float[Array, "H W 3"]) -> float:
    """Structural similarity (Wang et al. 2004): Gaussian window of 11 px, sigma 1.5 px, mean over
    channels and over the places where the window lies inside the picture.

    Raises InvalidInput for pictures smaller than the window.
    """
    _require_alike(made, truth)
    if min(made.shape[:2]) < _WINDOW_PX:
        raise InvalidInput(
            f"pictures must be at least {_WINDOW_PX} px a side for SSIM; got {made.shape[:2]}"
        )
    x, y = (
        torch.from_numpy(np.ascontiguousarray(p, np.float64)).movedim(-1, 0) for p in (made, truth)
    )
    stacked = torch.stack([x, y, x * x, y * y, x * y]).view(-1, 1, *made.shape[:2])
    offset = torch.arange(_WINDOW_PX, dtype=torch.float64) - _WINDOW_PX // 2
    window = torch.exp(-0.5 * (offset / _SIGMA_PX) ** 2)
    window = window / window.sum()
    blurred = functional.conv2d(stacked, window.view(1, 1, -1, 1))
    blurred = functional.conv2d(blurred, window.view(1, 1, 1, -1)).view(5, 3, -1)
    mean_x, mean_y, xx, yy, xy = blurred
    variance_x, variance_y = xx - mean_x**2, yy - mean_y**2
    c1, c2 = _K1**2, _K2**2
    similarity = ((2.0 * mean_x * mean_y + c1) * (2.0 * (xy - mean_x * mean_y) + c2)) / (
        (mean_x**2 + mean_y**2 + c1) * (variance_x + variance_y + c2)
    )
    return float(similarity.mean())


def over_black(image: Float[Array, "H W 3"], mask: Float[Array, "H W"]) -> Float[Array, "H W 3"]:
    """The person over black: the picture itself where it is so already, else cut by the mask."""
    outside = image[mask == 0.0]
    if outside.size and float(outside.mean()) < _BLACK:
        return image
    return image * mask[..., None]


def _require_alike(made: Array, truth: Array) -> None:
    if made.shape != truth.shape:
        raise InvalidInput(f"made must be as large as truth {truth.shape}; got {made.shape}")
