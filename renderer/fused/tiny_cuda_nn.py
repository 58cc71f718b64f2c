"""The same network on tiny-cuda-nn's FullyFusedMLP, where that is installed.

Its parameters are one flat vector: the weights [out, in] of all layers, first to last, with inputs
and outputs padded to multiples of 16 (tiny-cuda-nn, `fully_fused_mlp.cu`). Ours stay the masters:
the vector is made of them at every call, and gradients flow back through it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import torch
from torch.nn import functional

from scene.arrays import Float, Tensor

_TILE = 16


@cache
def has_tiny_cuda_nn() -> bool:
    """Whether tiny-cuda-nn is installed and runs here."""
    return find_spec("tinycudann") is not None and torch.cuda.is_available()


def tiny_cuda_nn_mlp(
    inputs: Float[Tensor, "N I"], weights: Sequence[Tensor], *, relu_last: bool
) -> Float[Tensor, "N O"]:
    """Outputs of the network with `weights` ([out, in] each, first to last)."""
    padded = functional.pad(inputs, (0, -inputs.shape[1] % _TILE))
    outputs = len(weights[-1])
    network = _network(
        padded.shape[1], outputs, len(weights[0]), len(weights) - 1, relu_last=relu_last
    )
    flat = {"params": flat_parameters(weights)}
    made: Tensor = torch.func.functional_call(network, flat, (padded,))
    return made[:, :outputs].float()


def flat_parameters(weights: Sequence[Tensor]) -> Float[Tensor, "P"]:
    """All weights as tiny-cuda-nn keeps them."""
    first, last = weights[0], weights[-1]
    whole = [
        functional.pad(first, (0, -first.shape[1] % _TILE)),
        *weights[1:-1],
        functional.pad(last, (0, 0, 0, -len(last) % _TILE)),
    ]
    return torch.cat([weight.reshape(-1) for weight in whole])


@cache
def _network(inputs: int, outputs: int, width: int, hidden: int, *, relu_last: bool) -> Any:
    return import_module("tinycudann").Network(
        inputs,
        outputs,
        {
            "otype": "FullyFusedMLP",
            "activation": "ReLU",
            "output_activation": "ReLU" if relu_last else "None",
            "n_neurons": width,
            "n_hidden_layers": hidden,
        },
    )
