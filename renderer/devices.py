"""Where fields compute: on a CUDA device where there is one, else on the CPU."""

from __future__ import annotations

import torch

from scene.arrays import Array, Tensor


def best_device() -> torch.device:
    """The CUDA device that torch would take, or the CPU.

    CUDA_VISIBLE_DEVICES chooses among several, or none.
    """
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def on_device(values: Array, device: torch.device, dtype: torch.dtype | None = None) -> Tensor:
    """A copy of `values`, of their own type or of `dtype`, on `device`."""
    return torch.tensor(values, dtype=dtype, device=device)


def on_host(values: Tensor) -> Array:
    """`values` as an array."""
    return values.detach().cpu().numpy()
