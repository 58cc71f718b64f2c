"""The canonical field: gradients, ranges, and where it starts."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest
import torch

from renderer.field.field import PersonField
from renderer.field.networks.canonical import CanonicalField
from renderer.field.sizes import FieldSizes, MlpSize
from tests.renderer.field.performer import TINY, body


@pytest.fixture(scope="module")
def field() -> PersonField:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return PersonField.for_body(TINY.sizes, body())


def _skin(offset_m: float) -> torch.Tensor:
    """Points of the torso's front, moved along z."""
    vertices = body().rest_vertices
    assert vertices is not None
    torso = vertices[(np.abs(vertices[:, 0]) < 0.1) & (np.abs(vertices[:, 1] - 1.1) < 0.1)]
    front = torso[torso[:, 2] > 0.05]
    assert len(front) > 5
    return torch.from_numpy(front + np.array([0.0, 0.0, offset_m])).float()


def test_starts_opaque_inside_and_empty_outside(field):
    with torch.no_grad():
        inside, outside, far = (field.canonical(_skin(d))[1] for d in (-0.03, 0.03, 0.3))
    assert inside.mean() > 30.0 * outside.mean()
    assert (far < 0.01).all()


def test_colours_and_densities_keep_their_ranges(field):
    points = torch.rand(500, 3) * 2.0 - 0.5
    colour, density = field.canonical(points)
    assert colour.shape == (500, 3)
    assert ((colour >= 0.0) & (colour <= 1.0)).all()
    assert (density >= 0.0).all()


def test_density_alone_agrees(field):
    points = _skin(0.0)
    place = field.canonical.located(points)
    assert torch.allclose(field.canonical.density_at(place), field.canonical(points)[1], rtol=1e-5)


def test_only_the_shell_learns(field):
    colour, density = field.canonical(torch.cat([_skin(-0.01), _skin(0.3)]))
    (colour.sum() + density.sum()).backward()
    gradient = field.canonical.table.grad
    assert gradient is not None
    assert (gradient[:2] == 0.0).all()
    assert (gradient[2:] != 0.0).any()


def test_may_hold_marks_the_shell(field):
    assert field.canonical.may_hold(_skin(0.0)).all()
    assert not field.canonical.may_hold(_skin(0.3)).any()


def test_gradients_against_finite_differences(field):
    twin = deepcopy(field.canonical).double()
    assert twin.table is not None
    with torch.no_grad():  # features far from the ReLU's bends
        twin.table[2:, 1:] *= 100.0
    # off the plane x = 0, where two cells meet and the slope jumps
    shift = torch.tensor([0.007, 0.0, 0.0])
    points = (_skin(0.003)[:4] + shift).double().requires_grad_(True)

    def rendered(places: torch.Tensor) -> torch.Tensor:
        colour, density = twin(places)
        return torch.cat([colour, density[:, None] / 100.0], dim=1)

    assert torch.autograd.gradcheck(rendered, (points,), eps=1e-7, atol=1e-4)


def test_the_papers_field_has_an_encoding_in_place_of_a_grid():
    sizes = FieldSizes(colour=MlpSize(depth=3, width=16, skip=2), octaves=4)
    field = CanonicalField(sizes, torch.zeros(3), torch.ones(3)).double()
    points = torch.rand(5, 3).double().requires_grad_(True)
    colour, density = field(points)
    assert ((colour > 0.0) & (colour < 1.0)).all()
    assert (density >= 0.0).all()
    assert torch.autograd.gradcheck(lambda p: field(p)[0], (points,))
