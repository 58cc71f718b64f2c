"""Positional encodings: sines and cosines at doubling frequencies, opened one by one by a window.

NeRF (Mildenhall et al. 2020, eq. 4); the Hann window is Nerfies' (Park et al. 2021, eq. 8), as
HumanNeRF uses it for its residual motion.
"""

from __future__ import annotations

import math

import torch

from scene.arrays import Float, Tensor


def encoded_size(octaves: int, *, identity: bool) -> int:
    """Numbers that a 3D point becomes."""
    return 3 * (2 * octaves + int(identity))


def positional_encoding(
    points: Float[Tensor, "N 3"],
    octaves: int,
    *,
    identity: bool,
    window: Float[Tensor, "L"] | None = None,
) -> Float[Tensor, "N E"]:
    """[x,] then sin(2^l x), cos(2^l x) for l = 0 .. octaves-1, each octave scaled by `window`."""
    parts = [points] if identity else []
    for octave in range(octaves):
        scaled = points * 2.0**octave
        for wave in (torch.sin(scaled), torch.cos(scaled)):
            parts.append(wave if window is None else wave * window[octave])
    return torch.cat(parts, dim=1) if parts else points[:, :0]


def hann_window(octaves: int, fraction: float) -> Float[Tensor, "L"]:
    """Weight of each octave when `fraction` (0 .. 1) of the opening has passed.

    w_l = (1 - cos(pi clamp(a - l, 0, 1))) / 2 with a = octaves * fraction: low octaves open first.
    """
    opened = octaves * min(max(fraction, 0.0), 1.0)
    share = (opened - torch.arange(octaves, dtype=torch.float32)).clamp(0.0, 1.0)
    return 0.5 * (1.0 - torch.cos(math.pi * share))
