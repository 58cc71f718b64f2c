"""What a model comes to whose numbers are stored in fewer bits."""

from __future__ import annotations

import tempfile
from pathlib import Path

import torch

from renderer.model_files import load_model, save_model
from renderer.performer_model import PerformerModel

PRECISIONS = ("float32", "float16", "bfloat16")
"""The first is that of training."""


def stored_in(model: PerformerModel, precision: str) -> PerformerModel:
    """`model` as a file would give it back that keeps every learnt number in `precision`, one of
    `PRECISIONS`; poses of its motion are left as they are."""
    from safetensors import safe_open
    from safetensors.torch import save_file

    kind = getattr(torch, precision)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.safetensors"
        save_model(model, path)
        with safe_open(path, "pt") as stored:
            about = stored.metadata()
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
        learnt = {
            name: value.to(kind).to(value.dtype)
            for name, value in tensors.items()
            if value.is_floating_point() and not name.startswith("motion.")
        }
        save_file({**tensors, **learnt}, path, metadata=about)
        return load_model(path)
