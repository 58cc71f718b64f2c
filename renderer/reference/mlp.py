"""The fused network, one row and one layer at a time: the twin to trust.

Twin of `renderer.fused.mlp.fused_mlp`, in whatever precision its arguments have.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from scene.arrays import Float, Tensor


def mlp(
    inputs: Float[Tensor, "N I"], weights: Sequence[Tensor], relu_last: bool = False
) -> Float[Tensor, "N O"]:
    """W_n relu(W_(n-1) ... relu(W_1 x)) of every row x."""
    rows = []
    for value in inputs:
        for weight in weights[:-1]:
            value = torch.relu(weight @ value)
        value = weights[-1] @ value
        rows.append(torch.relu(value) if relu_last else value)
    return torch.stack(rows)
