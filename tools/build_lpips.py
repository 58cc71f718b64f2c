"""Makes `renderer/assets/lpips_linear.safetensors`: `python -m tools.build_lpips`.

LPIPS weighs the channels of each compared layer; its authors' weights (version 0.1) for SqueezeNet,
AlexNet and VGG-16 come with the torchmetrics wheel, of which the product needs nothing else.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import torch
from safetensors.torch import save_file

from renderer.evaluation.lpips import LINEAR_LAYERS, TAPS
from scene.arrays import Tensor


def linear_layers() -> dict[str, Tensor]:
    """Weights of each channel by `BACKBONE.PLACE`, of shape 1 x channels x 1 x 1."""
    found = find_spec("torchmetrics")
    assert found is not None, "torchmetrics must be installed; run `make setup-test`"
    assert found.submodule_search_locations is not None
    folder = Path(found.submodule_search_locations[0]) / "functional" / "image" / "lpips_models"
    layers = {}
    for backbone, taps in TAPS.items():
        stored = torch.load(folder / f"{backbone}.pth", map_location="cpu", weights_only=True)
        for place in range(len(taps)):
            layers[f"{backbone}.{place}"] = stored[f"lin{place}.model.1.weight"].contiguous()
    return layers


if __name__ == "__main__":
    save_file(linear_layers(), LINEAR_LAYERS)
