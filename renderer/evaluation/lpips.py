"""LPIPS (Zhang et al. 2018): distance of deep features, without torchvision and without `lpips`.

The linear layers (version 0.1) ship with this package, made by `tools.build_lpips`; the backbone's
convolutions come from a .pth or .safetensors file with torchvision's names, `features.*`:
SqueezeNet 1.1 (which ships with this package), AlexNet or VGG-16, told apart by the shapes inside.
Pictures are sRGB in [0, 1] and go to the network in [-1, 1]; 0 means equal, about 0.3 is plainly
different.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import nn
from torch.nn import functional

from renderer.errors import RendererError
from scene.arrays import Float, Tensor

_ASSETS = Path(__file__).parents[1] / "assets"
PACKAGED_BACKBONE = _ASSETS / "squeezenet1_1.safetensors"
"""SqueezeNet 1.1, which ships with this package: figures without a network."""
LINEAR_LAYERS = _ASSETS / "lpips_linear.safetensors"
"""What the channels of each compared layer weigh, by `BACKBONE.PLACE`."""

_SHIFT = (-0.030, -0.088, -0.188)
_SCALE = (0.458, 0.448, 0.450)
"""Mean and spread of ImageNet in the range [-1, 1], as LPIPS has them."""
_FIRE = (3, 4, 6, 7, 9, 10, 11, 12)
TAPS = {
    "squeeze": (1, 4, 7, 9, 10, 11, 12),
    "alex": (1, 4, 7, 9, 11),
    "vgg": (3, 8, 15, 22, 29),
}
"""Layers (torchvision's numbers) after which features are compared."""
_CONVOLUTIONS = {
    # number: (stride, padding)
    "squeeze": {0: (2, 0)},
    "alex": {0: (4, 2), 3: (1, 2), 6: (1, 1), 8: (1, 1), 10: (1, 1)},
    "vgg": dict.fromkeys((0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28), (1, 1)),
}
_POOLS = {
    # number: (window, stride, round sizes up)
    "squeeze": {2: (3, 2, True), 5: (3, 2, True), 8: (3, 2, True)},
    "alex": {2: (3, 2, False), 5: (3, 2, False)},
    "vgg": dict.fromkeys((4, 9, 16, 23), (2, 2, False)),
}
_SMALLEST_PX = {"squeeze": 17, "alex": 31, "vgg": 16}
"""Side below which the last features would be empty."""


class Lpips(nn.Module):
    """The distance, differentiable in both pictures; its weights stay as they are."""

    shift: Tensor
    scale: Tensor

    def __init__(self, backbone: Path) -> None:
        """Read the convolutions from `backbone`. Raises RendererError for any other file."""
        super().__init__()
        weights = _read_weights(backbone)
        self.backbone = _kind(weights, backbone)
        """`squeeze`, `alex` or `vgg`."""
        for name, value in weights.items():
            if name.startswith("features."):
                self.register_buffer(name.replace(".", "_"), value.float())
        for place, layer in enumerate(_linear_layers(self.backbone)):
            self.register_buffer(f"linear_{place}", layer)
        self.register_buffer("shift", torch.tensor(_SHIFT).view(1, 3, 1, 1))
        self.register_buffer("scale", torch.tensor(_SCALE).view(1, 3, 1, 1))

    def forward(
        self, made: Float[Tensor, "B 3 H W"], truth: Float[Tensor, "B 3 H W"]
    ) -> Float[Tensor, "B"]:
        """Distance of each pair of pictures, sRGB in [0, 1]."""
        smallest = _SMALLEST_PX[self.backbone]
        if min(made.shape[2:]) < smallest:
            raise RendererError(
                f"pictures must be at least {smallest} px a side for LPIPS on {self.backbone}; "
                f"got {tuple(made.shape[2:])}"
            )
        total = made.new_zeros(len(made))
        pairs = zip(self._features(made), self._features(truth), strict=True)
        for place, (one, other) in enumerate(pairs):
            apart = (_unit(one) - _unit(other)) ** 2
            linear = self.get_buffer(f"linear_{place}")
            total = total + functional.conv2d(apart, linear).mean(dim=(1, 2, 3))
        return total

    def _features(self, pictures: Tensor) -> list[Tensor]:
        value = (2.0 * pictures - 1.0 - self.shift) / self.scale
        kind, taps = self.backbone, []
        for layer in range(TAPS[kind][-1] + 1):
            if layer in _CONVOLUTIONS[kind]:
                stride, padding = _CONVOLUTIONS[kind][layer]
                value = self._convolve(value, f"features_{layer}", stride, padding)
            elif layer in _POOLS[kind]:
                window, stride, up = _POOLS[kind][layer]
                value = functional.max_pool2d(value, window, stride, ceil_mode=up)
            elif kind == "squeeze" and layer in _FIRE:
                value = self._fire(value, f"features_{layer}")
            else:
                value = functional.relu(value)
            if layer in TAPS[kind]:
                taps.append(value)
        return taps

    def _fire(self, value: Tensor, name: str) -> Tensor:
        """SqueezeNet's block (Iandola et al. 2016): squeeze to few channels, expand two ways."""
        value = functional.relu(self._convolve(value, f"{name}_squeeze"))
        narrow = functional.relu(self._convolve(value, f"{name}_expand1x1"))
        wide = functional.relu(self._convolve(value, f"{name}_expand3x3", padding=1))
        return torch.cat([narrow, wide], dim=1)

    def _convolve(self, value: Tensor, name: str, stride: int = 1, padding: int = 0) -> Tensor:
        weight, bias = self.get_buffer(f"{name}_weight"), self.get_buffer(f"{name}_bias")
        return functional.conv2d(value, weight, bias, stride, padding)


def _unit(features: Tensor) -> Tensor:
    # the root of a nil vector has no gradient: keep it off zero
    return features * torch.rsqrt((features * features).sum(dim=1, keepdim=True) + 1e-8)


def _read_weights(path: Path) -> dict[str, Tensor]:
    try:
        if path.suffix == ".safetensors":
            from safetensors.torch import load_file

            return load_file(path)
        weights = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a pickle that is none breaks in many ways
        raise RendererError(
            f"LPIPS backbone must be a .pth or .safetensors of tensors; got {path}: {error}"
        ) from error
    if not isinstance(weights, dict):
        raise RendererError(
            f"LPIPS backbone must hold named tensors; got {type(weights)} in {path}"
        )
    return weights


def _kind(weights: dict[str, Tensor], path: Path) -> str:
    names = {
        "features.3.squeeze.weight": "squeeze",
        "features.28.weight": "vgg",
        "features.10.weight": "alex",
    }
    for name, kind in names.items():
        if name in weights:
            return kind
    raise RendererError(
        "LPIPS backbone must be SqueezeNet 1.1, AlexNet or VGG-16 with torchvision's names; got "
        f"{sorted(weights)[:3]} ... in {path}"
    )


def _linear_layers(kind: str) -> list[Tensor]:
    stored = _read_weights(LINEAR_LAYERS)
    return [stored[f"{kind}.{place}"] for place in range(len(TAPS[kind]))]
