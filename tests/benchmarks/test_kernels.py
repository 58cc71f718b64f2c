"""The kernels' benchmark: what it says without a GPU, and that it measures all kinds."""

from __future__ import annotations

import json

import pytest
import torch

from benchmarks import kernels


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device to measure")
def test_without_a_gpu_it_says_so(tmp_path, capsys):
    kernels.run(tmp_path / "kernels.json")
    assert "no CUDA device: the fused kernels were not measured" in capsys.readouterr().out
    report = json.loads((tmp_path / "kernels.json").read_text())
    assert report["device"] is None
    assert "rows" not in report


@pytest.mark.parametrize("backward", [False, True])
def test_every_kind_takes_its_turn(backward):
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    found = kernels.timed(device, 40, backward=backward, runs=2)
    assert set(found) == {"fused", "plain", "plain, half precision"}
    assert all(len(seconds) == 2 and min(seconds) > 0.0 for seconds in found.values())
