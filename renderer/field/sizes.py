"""How large each network of a field is, and which speed-ups are on: one frozen row a preset."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

_MOST = {"posed_grid": 256, "inverse_rounds": 64, "samples_a_ray": 4096}
"""Of a file's: what no tensor of it says, and a picture takes."""
_SHORTEST_STEP_M = 1e-4


@dataclass(frozen=True)
class MlpSize:
    """A fully connected network with ReLU between its layers."""

    depth: int
    """Hidden layers."""
    width: int
    """Units a hidden layer."""
    skip: int | None = None
    """The linear layer, counted from 1, that reads the encoding once more; None: none does."""
    bias: bool = True
    """Whether linear layers add a bias. Fully fused networks have none."""


@dataclass(frozen=True)
class GridSize:
    """A grid of features stored only in a shell around the rest surface."""

    voxel_m: float
    """Side of a cell."""
    channels: int
    """Features a grid point, beside its density."""
    inside_m: float
    """How far the shell reaches below the rest surface, m."""
    outside_m: float
    """How far it reaches above (clothes, hair, a body measured too thin), m."""


@dataclass(frozen=True)
class FieldSizes:
    """Every size of a field. A network whose row is None is left out."""

    colour: MlpSize | None
    """CanonicalField's MLP: colour and density of an encoded point, or colour alone of a grid's
    features (density is then read from the grid); None: the grid's features are the colour."""
    octaves: int = 0
    """Frequencies of the canonical encoding (10: 63 inputs); 0 where a grid encodes."""
    grid: GridSize | None = None
    volume: tuple[int, int, int] = (32, 32, 32)
    """Grid points of the weight volume along z, y and x."""
    latent: int = 0
    """Length of SkeletonMotion's latent z (the paper: 256); 0: no CNN, the prior is the volume."""
    latent_channels: int = 1024
    """Channels of the CNN's first volume; they halve at every second doubling of its side."""
    residual: MlpSize | None = None
    residual_octaves: int = 6
    refiner: MlpSize | None = None
    posed_grid: int = 0
    """Points a side of the grid that caches one pose's inverse skinning; 0: 24 look-ups a sample.
    """
    inverse_rounds: int = 0
    """Fixed-point rounds after HumanNeRF's inverse skinning; they make it the exact inverse of
    linear blend skinning. 0 as in the paper."""
    step_m: float = 0.01
    """Distance between samples along a ray, where `samples_a_ray` is nil."""
    samples_a_ray: int = 0
    """Samples of every ray between entering and leaving the body's box (the paper: 128)."""
    bone_prior: bool = False
    """Whether Gaussian bones are the prior of the weight volume, as in the paper, even where a
    surface with blend weights is known."""
    cull: bool = True
    """Whether samples where nobody is likely to be are skipped, before anything is asked there."""
    occupancy: bool = False
    """Whether samples are skipped where the canonical space was found empty after training."""
    early_stop: bool = True
    """Whether rays end where nothing behind can be seen."""
    baked: bool = False
    """Whether a trained model keeps its weight volume and drops the CNN that made it."""
    backend: str = "torch"
    """What runs the MLPs: `torch`, or `fused` (tiny-cuda-nn where it is installed, else our own
    kernel, else `torch` where neither runs)."""

    def to_json(self) -> dict[str, Any]:
        """Plain dicts and numbers, as model files store them."""
        return asdict(self)

    @classmethod
    def from_json(cls, stored: dict[str, Any]) -> FieldSizes:
        """The inverse of `to_json`. Raises KeyError, TypeError or ValueError for what is none."""
        parts = dict(stored)
        for name in ("colour", "residual", "refiner"):
            parts[name] = None if parts[name] is None else MlpSize(**parts[name])
        parts["grid"] = None if parts["grid"] is None else GridSize(**parts["grid"])
        parts["volume"] = tuple(parts["volume"])
        for name, most in _MOST.items():
            if not 0 <= parts[name] <= most:
                raise ValueError(f"{name} must be 0 to {most}; got {parts[name]}")
        if not parts["step_m"] >= _SHORTEST_STEP_M:
            raise ValueError(f"step_m must be at least {_SHORTEST_STEP_M}; got {parts['step_m']}")
        return cls(**parts)
