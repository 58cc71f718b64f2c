"""The kernels' benchmark measures all kinds."""

from __future__ import annotations

import pytest
import torch

from benchmarks import kernels


@pytest.mark.parametrize("backward", [False, True])
def test_every_kind_takes_its_turn(backward):
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    found = kernels.timed(device, 40, backward=backward, runs=2)
    assert set(found) == {"fused", "plain", "plain, half precision"}
    assert all(len(seconds) == 2 and min(seconds) > 0.0 for seconds in found.values())
