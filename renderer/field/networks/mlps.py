"""The paper's four networks: PoseRefiner, SkeletonMotion, ResidualMotion and CanonicalField's MLP.

Sizes come from `FieldSizes`; with HumanNeRF's (Weng et al. 2022) the parameters count 233,029,
63.59 M, 101,123 and 494,084. The last layers of refiner and residual start at U(-1e-5, 1e-5), so
that training starts from the poses as given and from a rigid body.
"""

from __future__ import annotations

import math
from typing import cast

import torch
from torch import nn
from torch.nn import functional

from renderer.field.networks.encoding import encoded_size, hann_window, positional_encoding
from renderer.field.sizes import FieldSizes, MlpSize
from renderer.fused.mlp import fused_mlp, require_fusible, runs_on
from scene.arrays import Float, Tensor

_LEAK = 0.2
"""Slope of the CNN's leaky ReLU below zero."""
_START = 1e-5
_TINY = 1e-8
"""Keeps the logarithm of a nil prior finite."""


def pose_numbers(joints: int) -> int:
    """Joint angles without the root: turning or moving the whole body changes nothing canonical."""
    return 3 * (joints - 1)


def parameter_count(module: nn.Module | None) -> int:
    """Learnt numbers in `module`; 0 for a network that is left out."""
    return 0 if module is None else sum(p.numel() for p in module.parameters())


class Mlp(nn.Module):
    """Linear layers with ReLU between them; one may read the inputs once more.

    The first layer may also read `shared` numbers that are the same for all rows of a call.
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        size: MlpSize,
        shared: int = 0,
        backend: str = "torch",
    ) -> None:
        """Raises InvalidInput for sizes that `backend` can't run."""
        super().__init__()
        self._skip = size.skip
        layers: list[nn.Module] = []
        for place in range(1, size.depth + 1):
            wide = inputs + shared if place == 1 else size.width
            wide += inputs if place == size.skip else 0
            layers.append(nn.Linear(wide, size.width, bias=size.bias))
        self.hidden = nn.ModuleList(layers)
        self.last = nn.Linear(size.width, outputs, bias=size.bias)
        self._fused = backend == "fused"
        if self._fused:
            for weights, _ in self._calls():
                require_fusible([tuple(w.shape) for w in weights], biased=size.bias)

    def forward(
        self, inputs: Float[Tensor, "N I"], shared: Float[Tensor, "S"] | None = None
    ) -> Float[Tensor, "N O"]:
        """Outputs without a final activation."""
        if self._fused and runs_on(inputs.device):
            return self._forward_fused(inputs, shared)
        first, *others = (cast(nn.Linear, layer) for layer in self.hidden)
        value = functional.relu(_first_layer(first, inputs, shared), inplace=True)
        for place, layer in enumerate(others, start=2):
            if place == self._skip:
                value = torch.cat([value, inputs], dim=1)
            value = functional.relu(layer(value), inplace=True)
        return self.last(value)

    def _forward_fused(
        self, inputs: Float[Tensor, "N I"], shared: Float[Tensor, "S"] | None
    ) -> Float[Tensor, "N O"]:
        value = inputs
        if shared is not None:
            value = torch.cat([inputs, shared.expand(len(inputs), -1)], dim=1)
        first, *then = self._calls()
        value = fused_mlp(value, *first)
        for weights, relu_last in then:
            value = fused_mlp(torch.cat([value, inputs], dim=1), weights, relu_last)
        return value

    def _calls(self) -> list[tuple[list[Tensor], bool]]:
        """Weights of each fused call, and whether it ends in ReLU: a skip cuts the network in
        two."""
        weights = [cast(nn.Linear, layer).weight for layer in [*self.hidden, self.last]]
        if self._skip is None:
            return [(weights, False)]
        cut = self._skip - 1
        return [(weights[:cut], True), (weights[cut:], False)]


def _first_layer(
    layer: nn.Linear, inputs: Float[Tensor, "N I"], shared: Float[Tensor, "S"] | None
) -> Float[Tensor, "N W"]:
    """What all rows share is a bias to each of them."""
    if shared is None:
        return layer(inputs)
    own, common = layer.weight.split([inputs.shape[1], len(shared)], dim=1)
    offset = common @ shared
    return functional.linear(inputs, own, offset if layer.bias is None else offset + layer.bias)


def _start_near_zero(layer: nn.Linear) -> None:
    nn.init.uniform_(layer.weight, -_START, _START)
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)


class PoseRefiner(nn.Module):
    """Corrections of joint angles, axis-angle, from the angles as given."""

    def __init__(self, size: MlpSize, joints: int, backend: str = "torch") -> None:
        super().__init__()
        self.mlp = Mlp(pose_numbers(joints), pose_numbers(joints), size, backend=backend)
        _start_near_zero(self.mlp.last)

    def forward(self, joint_angles: Float[Tensor, "F K 3"]) -> Float[Tensor, "F K 3"]:
        """Axis-angle corrections (rad), to be applied in each joint's own frame; the root's nil."""
        change = self.mlp(joint_angles[:, 1:].flatten(1)).view(len(joint_angles), -1, 3)
        return functional.pad(change, (0, 0, 1, 0))


class SkeletonMotion(nn.Module):
    """The weight volume: which joint moves each place of the canonical space, or none.

    softmax over K + 1 channels (K joints, then background) of CNN(z) + log prior, with z constant
    and learnt. Without a CNN the prior itself is the volume.
    """

    prior: Tensor

    def __init__(self, sizes: FieldSizes, prior: Float[Tensor, "C D H W"]) -> None:
        super().__init__()
        self.register_buffer("prior", prior)
        self.latent = None
        if sizes.latent:
            self.latent = nn.Parameter(torch.randn(sizes.latent))
            self.first = nn.Linear(sizes.latent, sizes.latent_channels)
            self.decoder = _decoder(sizes.latent_channels, sizes.volume[0], len(prior))

    def forward(self) -> Float[Tensor, "C D H W"]:
        """Probabilities; they sum to one over the first axis."""
        if self.latent is None:
            return self.prior
        seed = functional.leaky_relu(self.first(self.latent), _LEAK)
        logits = self.decoder(seed.view(1, -1, 1, 1, 1))[0]
        return torch.softmax(logits + torch.log(self.prior + _TINY), dim=0)


def _decoder(channels: int, side: int, outputs: int) -> nn.Sequential:
    """Transposed convolutions from 1^3 to side^3 (HumanNeRF's ConvDecoder3D)."""
    layers: list[nn.Module] = []
    inner, outer = channels, channels // 2
    for _ in range(int(math.log2(side)) - 1):
        layers += [nn.ConvTranspose3d(inner, outer, 4, 2, 1), nn.LeakyReLU(_LEAK)]
        inner, outer = (outer, outer // 2) if inner == outer else (outer, outer)
    return nn.Sequential(*layers, nn.ConvTranspose3d(inner, outputs, 4, 2, 1))


class ResidualMotion(nn.Module):
    """What bones do not explain: an offset (m) of each canonical point, given the pose."""

    def __init__(self, sizes: FieldSizes, joints: int) -> None:
        super().__init__()
        assert sizes.residual is not None
        self._octaves = sizes.residual_octaves
        encoded = encoded_size(self._octaves, identity=False)
        self.mlp = Mlp(encoded, 3, sizes.residual, pose_numbers(joints), backend=sizes.backend)
        _start_near_zero(self.mlp.last)

    def forward(
        self,
        points: Float[Tensor, "N 3"],
        joint_angles: Float[Tensor, "K 3"],
        opened: float,
    ) -> Float[Tensor, "N 3"]:
        """Offsets in canonical metres; `opened` is the Hann window's fraction, 0 .. 1."""
        window = hann_window(self._octaves, opened, points.device).to(points.dtype)
        encoded = positional_encoding(points, self._octaves, identity=False, window=window)
        return self.mlp(encoded, joint_angles[1:].reshape(-1))
