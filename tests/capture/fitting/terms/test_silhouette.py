"""Outlines of masks, and the surface that is to lie on them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from capture.fitting.terms.silhouette import (
    SIDE_PX,
    Silhouettes,
    prepare_silhouettes,
    silhouette_energy,
)
from scene.arrays import Array, Tensor

CENTRE, RADIUS = np.array([150.0, 120.0]), 60.0
DEVIATION_PX = torch.tensor([2.0])


def disc(width: int = 400, height: int = 300) -> Array:
    """An anti-aliased disc."""
    y, x = np.mgrid[:height, :width] + 0.5
    away = np.hypot(x - CENTRE[0], y - CENTRE[1])
    return np.clip(RADIUS - away + 0.5, 0.0, 1.0).astype(np.float32)


def test_outlines_lie_on_the_edge_to_a_fraction_of_a_pixel_and_point_outwards():
    outline = prepare_silhouettes([disc()])
    away = outline.contour[0].numpy() - CENTRE
    distance = np.linalg.norm(away, axis=1)
    np.testing.assert_allclose(distance, RADIUS, atol=0.75)
    assert abs(distance.mean() - RADIUS) < 0.25
    assert (np.sum(away / distance[:, None] * outline.normals[0].numpy(), axis=1) > 0.99).all()
    assert outline.contour_weight.all()


@pytest.mark.parametrize("size", [(400, 300), (1600, 1200)])
def test_distances_are_counted_from_the_edge_in_pixels_of_the_whole_picture(size):
    mask = np.zeros(size[::-1], np.float32)
    left, right, share = size[0] // 4, size[0] // 2, size[0] / 400.0
    mask[size[1] // 4 : size[1] // 2, left:right] = 1.0
    outline = prepare_silhouettes([mask])
    assert max(outline.distance.shape[1:3]) <= SIDE_PX
    off = np.array([-20.0, -2.0, 0.0, 1.0, 3.0, 6.0]) * share
    places = np.stack([right + off, np.full(len(off), size[1] * 0.375)], axis=-1)
    pixels = torch.tensor(places[None], dtype=torch.float32, requires_grad=True)
    found = outline.outside(pixels)
    np.testing.assert_allclose(found[0].detach(), np.maximum(off, 0.0), atol=0.6 * share)
    found.sum().backward()
    assert pixels.grad is not None
    assert (pixels.grad[0, -2:, 0] > 0.9).all()
    assert (pixels.grad[0, :2] == 0.0).all()


def test_what_leaves_the_picture_and_lost_frames_are_not_outside():
    outline = prepare_silhouettes([disc(), None])
    beyond = torch.tensor([[[-50.0, 100.0], [450.0, 100.0]]]).expand(2, 2, 2)
    assert outline.outside(beyond).tolist() == [[0.0, 0.0], [0.0, 0.0]]
    assert outline.outside(torch.tensor([[[260.0, 120.0]]]).expand(2, 1, 2))[:, 0].tolist() == [
        pytest.approx(50.0, abs=1.5),
        0.0,
    ]
    assert outline.contour_weight[1].sum() == 0.0


def sphere(outline: Silhouettes) -> tuple[Tensor, Tensor, Tensor]:
    """Pixels, normals and places of a sphere that fills the disc, before a camera far away."""
    turn = torch.rand(4000, 3, generator=torch.Generator().manual_seed(0)) - 0.5
    normals = torch.nn.functional.normalize(turn, dim=-1)
    skin = normals + torch.tensor([0.0, 0.0, -1000.0])
    flipped = normals[:, :2] * torch.tensor([1.0, -1.0])
    pixels = torch.tensor(CENTRE, dtype=torch.float32) + RADIUS * flipped
    return pixels[None], normals[None], skin[None]


def test_each_point_of_the_outline_finds_what_makes_it():
    outline = prepare_silhouettes([disc()])
    pixels, normals, skin = sphere(outline)
    nearest = outline.nearest(pixels, normals, skin)[0]
    assert (normals[0, nearest, 2].abs() < 0.2).all()
    gap = (pixels[0, nearest] - outline.contour[0]).norm(dim=-1)
    assert gap.max() < 8.0


def test_a_vertex_that_faces_as_the_outline_does_is_chosen_before_a_nearer_one():
    """A leg's inner edge lies by the other leg's, which faces the other way."""
    outline = prepare_silhouettes([disc()])
    points = outline.contour.shape[1]
    flat = outline.normals * torch.tensor([1.0, -1.0])
    alike = torch.cat([flat, torch.zeros(1, points, 1)], -1)
    pixels = torch.cat([outline.contour + 8.0 * outline.normals, outline.contour], 1)
    skin = torch.tensor([0.0, 0.0, -3.0]).expand(1, 2 * points, 3)
    nearest = outline.nearest(pixels, torch.cat([alike, -alike], 1), skin)
    assert (nearest < points).all()


def test_the_outline_draws_across_and_hardly_along():
    outline = prepare_silhouettes([disc()])
    inside = torch.tensor(CENTRE, dtype=torch.float32).expand(1, 10, 2)

    def energy(reached: Tensor, worn: float = 0.0) -> float:
        shown = torch.ones(1, 10)
        return float(
            silhouette_energy(outline, inside, reached, shown, torch.tensor([worn]), DEVIATION_PX)
        )

    along = outline.normals @ torch.tensor([[0.0, 1.0], [-1.0, 0.0]])
    assert energy(outline.contour) == 0.0
    across = energy(outline.contour + 3.0 * outline.normals)
    assert energy(outline.contour + 3.0 * along) == pytest.approx(0.09 * across, rel=0.05)
    # clothes lie outside the skin that makes the outline
    assert energy(outline.contour - 3.0 * outline.normals, 3.0) == pytest.approx(0.0, abs=1e-4)
    outside = inside + torch.tensor([100.0, 0.0])
    assert (
        float(
            silhouette_energy(
                outline, outside, outline.contour, torch.zeros(1, 10), torch.zeros(1), DEVIATION_PX
            )
        )
        == 0.0
    )
    assert (
        float(
            silhouette_energy(
                outline, outside, outline.contour, torch.ones(1, 10), torch.zeros(1), DEVIATION_PX
            )
        )
        > 10.0
    )
