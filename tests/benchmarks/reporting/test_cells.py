"""A picture fits into its cell whole, in the middle."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.reporting.cells import in_a_cell


@pytest.mark.parametrize("size", [(20, 40), (40, 20), (5, 9)])
def test_a_picture_is_as_large_as_its_cell_allows_and_in_its_middle(size: tuple[int, int]):
    cell = in_a_cell(np.ones((*size, 3)), (30, 30))
    assert cell.shape == (30, 30, 3)
    shown = np.argwhere(cell[..., 0] > 0.5)
    high, wide = np.ptp(shown, axis=0) + 1
    assert max(high, wide) == 30
    assert wide / high == pytest.approx(size[1] / size[0], abs=0.1)
    assert np.abs(shown.mean(axis=0) - 14.5).max() <= 0.5
