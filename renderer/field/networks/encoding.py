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
    scales = 2.0 ** torch.arange(octaves, dtype=points.dtype, device=points.device)
    scaled = points[:, None] * scales[:, None]
    waves = torch.stack([torch.sin(scaled), torch.cos(scaled)], dim=2)
    if window is not None:
        waves = waves * window[:, None, None]
    encoded = waves.flatten(1)
    return torch.cat([points, encoded], dim=1) if identity else encoded


def hann_window(
    octaves: int, fraction: float, device: torch.device | None = None
) -> Float[Tensor, "L"]:
    """Weight of each octave when `fraction` (0 .. 1) of the opening has passed.

    w_l = (1 - cos(pi clamp(a - l, 0, 1))) / 2 with a = octaves * fraction: low octaves open first.
    """
    opened = octaves * min(max(fraction, 0.0), 1.0)
    share = (opened - torch.arange(octaves, dtype=torch.float32, device=device)).clamp(0.0, 1.0)
    return 0.5 * (1.0 - torch.cos(math.pi * share))
