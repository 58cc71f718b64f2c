"""How a field is trained: its sizes, rates and schedules. One frozen row a preset."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
    most_px: int | None = None
    """Longest side of the frames' crops; larger ones are shrunk. None: as they are."""
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
    iterations: int | None = None
    """Steps of the whole schedule where it was published with a count. A run of another length
    scales all of it, and its model says by how much."""


FAST = FieldSettings(
    sizes=FieldSizes(
        colour=MlpSize(depth=1, width=16),
        grid=GridSize(voxel_m=0.008, channels=4, inside_m=0.03, outside_m=0.04),
        volume=(32, 96, 96),
        posed_grid=48,
        inverse_rounds=3,
    ),
    table_rate=0.2,
    field_rate=1e-2,
    motion_rate=1e-3,
    rays_a_frame=256,
    most_px=512,
)
"""Two CPU cores, a minute. Measured on a plain performer of 60 frames, 256 px:

- a grid in a shell takes the place of the deep canonical MLP; behind it 16 units on 4 features do
  as well as 32 on 8, and better than none (+0.4 dB in the same time);
- the CNN is out: with a known surface its prior already is the weight volume;
- the residual is out: a tight body has none, and it must be asked at every sample;
- exact inverse skinning costs 3 rounds once a pose; 48 grid points a side do as well as 96;
- the refiner is out: poses that change with each step let no pose be inverted once, so a step takes
  five times as long, and real people, in captured poses, have more LPIPS in unseen frames by it.
"""

_PAPER_ITERATIONS = 150_000


def _as_published(sizes: FieldSizes) -> FieldSettings:
    """HumanNeRF's training (Weng et al. 2022, sec. 4 and its released configuration), which the
    paper keeps: 6 patches of 20 x 20 px of one frame a step, 0.2 MSE + LPIPS, residual from 10K and
    open at 50K, refiner from 20K, rates falling by 0.1 over 500K."""
    return FieldSettings(
        sizes=sizes,
        frames_a_step=1,
        rays_a_frame=6 * 20 * 20,
        patch_px=20,
        last_rate_share=0.1 ** (_PAPER_ITERATIONS / 500_000),
        refine_from=20_000 / _PAPER_ITERATIONS,
        residual_from=10_000 / _PAPER_ITERATIONS,
        residual_until=50_000 / _PAPER_ITERATIONS,
        iterations=_PAPER_ITERATIONS,
    )


HUMANNERF = _as_published(
    FieldSizes(
        colour=MlpSize(depth=8, width=256, skip=6),
        octaves=10,
        volume=(32, 32, 32),
        latent=256,
        residual=MlpSize(depth=6, width=128, skip=5),
        refiner=MlpSize(depth=4, width=256),
        samples_a_ray=128,
        bone_prior=True,
        cull=False,
        early_stop=False,
    )
)
"""The baseline: HumanNeRF's own sizes, in plain torch, every sample asked."""

PAPER = replace(
    HUMANNERF,
    sizes=replace(
        HUMANNERF.sizes,
        colour=MlpSize(depth=8, width=64, skip=4, bias=False),
        residual=MlpSize(depth=6, width=64, skip=4, bias=False),
        refiner=MlpSize(depth=4, width=64, bias=False),
        backend="fused",
    ),
)
"""The paper's: the same depths, 64 wide, fully fused. A skip cuts such a network into two calls."""
