"""Fields of MLPs that look like a body without having been trained on pictures."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch.nn import functional

from renderer.field.field import PersonField
from renderer.field.settings import PAPER
from renderer.field.sizes import FieldSizes, MlpSize
from renderer.field.skinning.rest_shape import rest_shape
from renderer.field.training.pruning import occupied_cells
from tests.renderer.field.performer import body

SMALL = replace(
    PAPER.sizes,
    colour=MlpSize(depth=3, width=32, skip=3, bias=False),
    octaves=6,
    residual=MlpSize(depth=3, width=16, skip=3, bias=False),
    refiner=None,
    latent=8,
    latent_channels=16,
    samples_a_ray=96,
    backend="torch",
)
_DENSITY = 300.0
_SOFTNESS_M = 0.004


def shaped_field(sizes: FieldSizes = SMALL, steps: int = 300, points: int = 4096) -> PersonField:
    """A field whose canonical MLP was fitted to the body's own shape, painted with soft stripes;
    its residual moves everything by about a millimetre."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        field = PersonField.for_body(sizes, body())
        if field.residual is not None:
            torch.nn.init.normal_(field.residual.mlp.last.weight, std=1e-3)
        shape = rest_shape(body(), (48, 96, 96), 0.04)
        distance = torch.from_numpy(shape.signed_distance)[None, None]
        low, high = torch.from_numpy(shape.low), torch.from_numpy(shape.high)
        vertices = torch.from_numpy(body().rest_vertices).float()
        adam = torch.optim.Adam(field.canonical.parameters(), lr=2e-3)
        for step in range(steps):
            for group in adam.param_groups:
                group["lr"] = 2e-3 * 0.03 ** (step / steps)
            near = vertices[torch.randint(len(vertices), (points // 2,))]
            anywhere = low + torch.rand(points // 2, 3) * (high - low)
            at = torch.cat([near + 0.04 * torch.randn(near.shape), anywhere])
            unit = (at - low) / (high - low)
            away = functional.grid_sample(
                distance,
                (2.0 * unit - 1.0).view(1, 1, 1, -1, 3),
                padding_mode="border",
                align_corners=True,
            ).view(-1)
            wanted = _DENSITY * torch.sigmoid(-away / _SOFTNESS_M)
            paint = 0.5 + 0.4 * torch.sin(at[:, 1:2] * torch.tensor([20.0, 9.0, 4.0]))
            colours, density = field.canonical(at)
            apart = torch.log1p(density) - torch.log1p(wanted)
            painted = ((colours - paint) ** 2).sum(1) * (away.abs() < 0.05)
            loss = 0.1 * (apart**2).mean() + painted.mean()
            adam.zero_grad()
            loss.backward()
            adam.step()
        field.requires_grad_(False)
        field.residual_opened = 1.0
        field.occupied = occupied_cells(field.canonical, field.weight_volume())
        return field
