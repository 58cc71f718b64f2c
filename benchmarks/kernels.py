"""The fully fused MLP against plain PyTorch on one GPU: ms at p50 and p95, and times faster.

2^20 samples, forward alone and forward with backward (weights and inputs), through a network like
the paper's canonical MLP: 63 inputs, 8 x 64, without its skip. Plain runs are in single precision,
as networks without a fused kernel are, and in half precision under autocast. Runs of all kinds take
turns, so that what else the machine does falls on each.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import torch
from torch.nn import functional

from benchmarks.inputs import require_cuda
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import milliseconds
from renderer.devices import best_device
from renderer.fused.mlp import fused_mlp
from renderer.fused.tiny_cuda_nn import has_tiny_cuda_nn
from scene.arrays import Tensor

SAMPLES = 2**20
_SHAPES = ((64, 63), *((64, 64),) * 7, (4, 64))
_WARM_UPS, _RUNS = 3, 30

Network = Callable[[Tensor, list[Tensor]], Tensor]


def run(writer: FigureWriter) -> None:
    """Measure and report.

    Raises InvalidInput where there is no CUDA device.
    """
    require_cuda()
    device = best_device()
    about = {"samples": SAMPLES, "layers": [list(shape) for shape in _SHAPES]}
    rows = []
    for what in ("forward", "forward+backward"):
        found = timed(device, SAMPLES, backward=what != "forward")
        for kind, seconds in found.items():
            rows.append({"kind": kind, "what": what, **milliseconds(seconds)})
        fused = milliseconds(found["fused"])["p50_ms"]
        for row in rows[-len(found) :]:
            row["fused_times_faster"] = round(row["p50_ms"] / fused, 2)
    fused_by = "tiny-cuda-nn" if has_tiny_cuda_nn() else "our kernel"
    name = torch.cuda.get_device_name(device)
    writer.write({**about, "device": name, "fused": fused_by, "rows": rows})


def timed(
    device: torch.device, samples: int, *, backward: bool, runs: int = _RUNS
) -> dict[str, list[float]]:
    """Seconds of every run, by kind of network."""
    chance = torch.Generator().manual_seed(0)
    weights = [
        (torch.randn(shape, generator=chance) / shape[1] ** 0.5).to(device).requires_grad_(backward)
        for shape in _SHAPES
    ]
    inputs = torch.randn(samples, _SHAPES[0][1], generator=chance).to(device)
    inputs.requires_grad_(backward)
    kinds: dict[str, Network] = {
        "fused": fused_mlp,
        "plain": _plain,
        "plain, half precision": _plain_in_half,
    }
    seconds: dict[str, list[float]] = {kind: [] for kind in kinds}
    for place in range(_WARM_UPS + runs):
        for kind, network in kinds.items():
            _finish(device)
            started = time.perf_counter()
            outputs = network(inputs, weights)
            if backward:
                torch.autograd.grad(outputs.sum(), [inputs, *weights])
            _finish(device)
            if place >= _WARM_UPS:
                seconds[kind].append(time.perf_counter() - started)
    return seconds


def _finish(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def _plain(inputs: Tensor, weights: list[Tensor]) -> Tensor:
    value = inputs
    for weight in weights[:-1]:
        value = functional.relu(functional.linear(value, weight))
    return functional.linear(value, weights[-1])


def _plain_in_half(inputs: Tensor, weights: list[Tensor]) -> Tensor:
    half = torch.bfloat16 if inputs.device.type == "cpu" else torch.float16
    with torch.autocast(inputs.device.type, dtype=half):
        return _plain(inputs, weights)
