"""Slopes of a picture are found along the axes that they lie along."""

from __future__ import annotations

import numpy as np
import pytest

from scene.structure_tensor import structure_tensor


@pytest.mark.parametrize(("x", "y"), [(3, 0), (0, 2), (2, 1), (1, -2)])
def test_a_ramp_has_the_products_of_its_slopes_everywhere(x: int, y: int):
    down, right = np.mgrid[:40, :40]
    grey = (120 + x * (right - 20) + y * (down - 20)).astype(np.uint8)
    found = [one[12:28, 12:28] for one in structure_tensor(grey, 1.5)]
    for tensor, product in zip(found, (x * x, x * y, y * y), strict=True):
        np.testing.assert_allclose(tensor, product, atol=1e-4)
