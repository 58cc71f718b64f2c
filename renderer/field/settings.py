"""How a field is trained: its sizes, rates and schedules. One frozen row a preset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from renderer.field.sizes import FieldSizes, GridSize, MlpSize


@dataclass(frozen=True)
class FieldSettings:
    """Everything a preset of the field decides."""

    sizes: FieldSizes
    table_rate: float = 3e-2
    """Adam's rate for grid features."""
    field_rate: float = 5e-4
    """The same for the canonical MLP."""
    motion_rate: float = 5e-5
    """The same for refiner, weight volume and residual."""
    last_rate_share: float = 0.1
    """Rates fall exponentially to this share at the end of the schedule."""
    frames_a_step: int = 4
    rays_a_frame: int = 1024
    beside_share: float = 0.15
    """Share of the rays that pass beside the body, through the shell alone."""
    patch_px: int = 0
    """Side of square patches, which a perceptual loss needs; 0: single rays."""
    on_body_share: float = 0.8
    """Share of patches centred on the body."""
    lpips_backbone: Path | None = None
    """File with the backbone of a perceptual loss on patches; None: pixels alone."""
    lpips_weight: float = 1.0
    patch_mse_weight: float = 0.2
    """Weights of the two losses where there is a backbone (the paper's)."""
    refine_from: float = 0.1
    """Share of the schedule after which the refiner starts."""
    residual_from: float = 0.07
    """Share of the schedule after which the residual starts (the paper: 10K of 150K steps)."""
    residual_until: float = 0.33
    """Share at which its window is fully open (50K of 150K)."""
    pixel_loss: str = "mse"
    """`mse` as in the paper, or `l1`, which forgives the few pixels that can't be explained."""


FAST = FieldSettings(
    sizes=FieldSizes(
        colour=MlpSize(depth=1, width=16),
        grid=GridSize(voxel_m=0.008, channels=4, inside_m=0.03, outside_m=0.04),
        volume=(32, 96, 96),
        refiner=MlpSize(depth=2, width=64),
        posed_grid=48,
        inverse_rounds=3,
    ),
    table_rate=0.2,
    field_rate=1e-2,
    motion_rate=1e-3,
    rays_a_frame=256,
)
"""Two CPU cores, a minute. Measured on a plain performer of 60 frames, 256 px:

- a grid in a shell takes the place of the deep canonical MLP; behind it 16 units on 4 features do
  as well as 32 on 8, and better than none (+0.4 dB in the same time);
- the CNN is out: with a known surface its prior already is the weight volume;
- the residual is out: a tight body has none, and it must be asked at every sample;
- exact inverse skinning costs 3 rounds once a pose; 48 grid points a side do as well as 96;
- the refiner works only where poses were estimated.
"""
