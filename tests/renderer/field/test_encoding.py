"""Positional encodings and their window."""

from __future__ import annotations

import math

import pytest
import torch

from renderer.field.networks.encoding import encoded_size, hann_window, positional_encoding


@pytest.mark.parametrize(
    ("fraction", "expected"),
    [
        (0.0, [0.0, 0.0, 0.0, 0.0]),
        (0.125, [0.5, 0.0, 0.0, 0.0]),
        (0.25, [1.0, 0.0, 0.0, 0.0]),
        (0.3125, [1.0, 0.5 * (1.0 - math.cos(math.pi / 4.0)), 0.0, 0.0]),
        (1.0, [1.0, 1.0, 1.0, 1.0]),
        (7.0, [1.0, 1.0, 1.0, 1.0]),
    ],
)
def test_hann_window_golden(fraction, expected):
    assert torch.allclose(hann_window(4, fraction), torch.tensor(expected), atol=1e-6)


def test_encoding_golden():
    point = torch.tensor([[0.5, 0.0, -0.25]])
    got = positional_encoding(point, 2, identity=True)
    expected = [0.5, 0.0, -0.25]
    for scale in (1.0, 2.0):
        expected += [math.sin(scale * x) for x in (0.5, 0.0, -0.25)]
        expected += [math.cos(scale * x) for x in (0.5, 0.0, -0.25)]
    assert torch.allclose(got, torch.tensor([expected]), atol=1e-6)


def test_sizes_are_the_papers():
    assert encoded_size(10, identity=True) == 63
    assert encoded_size(6, identity=False) == 36


def test_a_closed_window_leaves_nothing():
    encoded = positional_encoding(torch.rand(5, 3), 3, identity=False, window=hann_window(3, 0.0))
    assert encoded.shape == (5, 18)
    assert (encoded == 0.0).all()
