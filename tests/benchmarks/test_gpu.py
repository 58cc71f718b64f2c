"""The GPU's benchmarks where there may be no GPU."""

from __future__ import annotations

import pytest
import torch

from benchmarks import gpu, kernels
from benchmarks.reporting.checkout import Checkout
from benchmarks.reporting.figures import FigureWriter
from scene.errors import InvalidInput


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device to measure")
@pytest.mark.parametrize("name", ["gpu", "kernels"])
def test_without_a_gpu_it_says_so_and_writes_nothing(tmp_path, name):
    writer = FigureWriter.start(name, checkout=Checkout(tmp_path), words=["bench", name])
    with pytest.raises(InvalidInput, match="a CUDA device and Triton must be at hand; got no CUDA"):
        gpu.run(writer, []) if name == "gpu" else kernels.run(writer)
    assert not list(tmp_path.iterdir())
