"""The layers of LPIPS that ship with the renderer are the published ones."""

from __future__ import annotations

import torch
from safetensors.torch import load_file

from renderer.evaluation.lpips import LINEAR_LAYERS
from tools.build_lpips import linear_layers


def test_asset_is_what_the_builder_makes():
    made, stored = linear_layers(), load_file(LINEAR_LAYERS)
    assert made.keys() == stored.keys()
    assert all(torch.equal(made[name], stored[name]) for name in made)
