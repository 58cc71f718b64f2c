"""The network of `capture.detection.lifter` in torch, for training; numpy runs it afterwards."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from capture.detection.lifter import BLOCKS, FEATURES, OUTPUTS
from scene.arrays import Float, Tensor
from scene.skeleton import JOINT_COUNT, PARENTS

WIDTH = 512
_DROPOUT = 0.2


class _Layer(nn.Module):
    """Linear, layer norm, SiLU and dropout."""

    def __init__(self) -> None:
        super().__init__()
        self.linear, self.norm = nn.Linear(WIDTH, WIDTH), nn.LayerNorm(WIDTH)
        self.dropout = nn.Dropout(_DROPOUT)

    def forward(self, x: Tensor) -> Tensor:
        return self.dropout(functional.silu(self.norm(self.linear(x))))


class LifterNetwork(nn.Module):
    """Features [N F] and closed-form global rotations [N 24 3 3] to global rotations and log
    spreads."""

    mean: Tensor
    deviation: Tensor

    def __init__(self, mean: Float[Tensor, "F"], deviation: Float[Tensor, "F"]) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("deviation", deviation)
        self.first = nn.Linear(FEATURES, WIDTH)
        self.blocks = nn.ModuleList(nn.Sequential(_Layer(), _Layer()) for _ in range(BLOCKS))
        self.last = nn.Linear(WIDTH, OUTPUTS)

    def forward(self, features: Tensor, closed_form: Tensor) -> tuple[Tensor, Tensor]:
        hidden = functional.silu(self.first((features - self.mean) / self.deviation))
        for block in self.blocks:
            hidden = hidden + block(hidden)
        output = self.last(hidden)
        pair = output[:, : 6 * JOINT_COUNT].view(-1, JOINT_COUNT, 2, 3) + torch.eye(3)[:2]
        a = functional.normalize(pair[..., 0, :], dim=-1)
        b = pair[..., 1, :] - (a * pair[..., 1, :]).sum(-1, keepdim=True) * a
        b = functional.normalize(b, dim=-1)
        rotations = closed_form @ torch.stack([a, b, torch.linalg.cross(a, b)], -1)
        return rotations, output[:, 6 * JOINT_COUNT :]

    def exported(self) -> dict[str, Tensor]:
        """Weights by the names that `capture.detection.lifter` knows."""
        return dict(self.state_dict())


def local_rotations(world: Float[Tensor, "N 24 3 3"]) -> Float[Tensor, "N 24 3 3"]:
    """Rotations relative to the parent's; the root's are unchanged."""
    parents = world[:, [max(parent, 0) for parent in PARENTS]].transpose(-1, -2)
    return torch.cat([world[:, :1], (parents @ world)[:, 1:]], 1)


def forward_kinematics(
    world: Float[Tensor, "N 24 3 3"], rest: Float[Tensor, "N 24 3"]
) -> Float[Tensor, "N 24 3"]:
    """Positions of the joints relative to the root, m."""
    positions = [torch.zeros_like(rest[:, 0])]
    for joint in range(1, JOINT_COUNT):
        parent = PARENTS[joint]
        bone = (rest[:, joint] - rest[:, parent])[..., None]
        positions.append(positions[parent] + (world[:, parent] @ bone)[..., 0])
    return torch.stack(positions, 1)
