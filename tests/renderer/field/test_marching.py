"""Volume rendering: golden values, the slow twin, gradients."""

from __future__ import annotations

import math

import torch

from renderer.field.rendering.ray_marching import (
    Samples,
    alphas,
    box_span,
    composite,
    compositing_weights,
    joined,
    march,
    packed,
    steps_of,
)
from renderer.reference.volume_rendering import render_ray

STEP_M = 0.01


def _samples(live: torch.Tensor) -> Samples:
    t = torch.arange(live.shape[1]).double().expand(live.shape)
    ones = torch.ones(len(live), 3).double()
    return packed(live, t, torch.full((len(live),), STEP_M).double(), 0.0 * ones, ones)


def test_alpha_golden():
    density, likelihood = torch.tensor([100.0, 100.0, 0.0, 1e9]), torch.tensor([1.0, 0.5, 1.0, 1.0])
    expected = torch.tensor([1.0 - math.exp(-1.0), 0.5 * (1.0 - math.exp(-1.0)), 0.0, 1.0])
    assert torch.allclose(alphas(density, likelihood, torch.full((4,), 0.01)), expected)


def test_box_span_golden():
    low, high = torch.tensor([-1.0, -1.0, -1.0]), torch.tensor([1.0, 1.0, 1.0])
    origins = torch.tensor([[-3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-3.0, 5.0, 0.0]])
    near, far = box_span(origins, torch.tensor([[1.0, 0.0, 0.0]]).expand(3, 3), low, high)
    assert near[:2].tolist() == [2.0, 0.0]
    assert far[:2].tolist() == [4.0, 1.0]
    assert near[2] >= far[2]


def test_rays_that_all_miss_the_body_have_no_samples():
    """As those of a patch of pixels beside it may."""
    nowhere = torch.full((4,), torch.inf)
    span = nowhere, -nowhere
    ones = torch.ones(4, 3)
    steps = steps_of(span, STEP_M)
    assert steps[1] == 1
    samples = march(None, 0.0 * ones, ones, span, steps)
    assert (len(samples.ray), samples.rays) == (0, 4)


def test_agrees_with_the_slow_twin():
    generator = torch.Generator().manual_seed(0)
    live = torch.rand(7, 12, generator=generator) < 0.5
    live[3] = False
    samples = _samples(live)
    count = len(samples.ray)
    colours = torch.rand(count, 3, generator=generator).double()
    density = 200.0 * torch.rand(count, generator=generator).double()
    likelihood = torch.rand(count, generator=generator).double()
    weights, _ = compositing_weights(alphas(density, likelihood, samples.step), samples)
    got = composite(weights, colours, samples)
    for ray in range(7):
        mine = samples.ray == ray
        expected = render_ray(colours[mine], density[mine], likelihood[mine], 0.01)
        assert torch.allclose(got[ray], expected, atol=1e-5)


def test_gradients_against_finite_differences():
    generator = torch.Generator().manual_seed(1)
    samples = _samples(torch.rand(3, 5, generator=generator) < 0.7)
    count = len(samples.ray)

    def rendered(colours: torch.Tensor, density: torch.Tensor, f: torch.Tensor) -> torch.Tensor:
        weights, _ = compositing_weights(alphas(density, f, samples.step), samples)
        return composite(weights, colours, samples)

    inputs = (
        torch.rand(count, 3, generator=generator).double().requires_grad_(True),
        (100.0 * torch.rand(count, generator=generator).double()).requires_grad_(True),
        torch.rand(count, generator=generator).double().requires_grad_(True),
    )
    assert torch.autograd.gradcheck(rendered, inputs)


def test_joined_bundles_render_as_each_alone():
    generator = torch.Generator().manual_seed(2)
    lives = [torch.rand(4, 6, generator=generator) < 0.6 for _ in range(2)]
    bundles = [_samples(live) for live in lives]
    alpha = [torch.rand(len(b.ray), generator=generator).double() for b in bundles]
    whole, _ = compositing_weights(torch.cat(alpha), joined(bundles))
    alone = [compositing_weights(a, b)[0] for a, b in zip(alpha, bundles, strict=True)]
    assert torch.allclose(whole, torch.cat(alone))


def test_a_bundle_that_meets_nothing_is_transparent():
    samples = _samples(torch.zeros(3, 4, dtype=torch.bool))
    weights, _ = compositing_weights(torch.zeros(0).double(), samples)
    assert composite(weights, torch.zeros(0, 3).double(), samples).tolist() == [[0.0] * 4] * 3
