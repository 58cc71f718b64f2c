"""Volume rendering, one ray and one sample at a time: the twin to trust.

HumanNeRF (Weng et al. 2022, eq. 8-9). Twin of the packed version in
`renderer.field.rendering.ray_marching`.
"""

from __future__ import annotations

import torch

from scene.arrays import Float, Tensor


def render_ray(
    colours: Float[Tensor, "S 3"],
    densities: Float[Tensor, "S"],
    likelihoods: Float[Tensor, "S"],
    step_m: float,
) -> Float[Tensor, "4"]:
    """Premultiplied RGBA of the samples of one ray, front to back."""
    rgb, through = colours.new_zeros(3), colours.new_ones(())
    for colour, density, likelihood in zip(colours, densities, likelihoods, strict=True):
        alpha = likelihood * (1.0 - torch.exp(-density * step_m))
        rgb = rgb + through * alpha * colour
        through = through * (1.0 - alpha)
    return torch.cat([rgb, (1.0 - through)[None]])
