"""The neural field's ladder: one size of the preset `fast` changed at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.parsimony.costs import costs
from benchmarks.parsimony.subjects import Filmed
from benchmarks.reporting.timing import Clock
from benchmarks.stability.material import FrameList, frames_of
from benchmarks.stability.poses import noisy
from renderer.evaluation.lpips import PACKAGED_BACKBONE
from renderer.field.settings import FieldSettings
from renderer.field.sizes import FieldSizes, GridSize, MlpSize
from renderer.presets import find_preset
from renderer.training import train
from scene.sequence import PoseTrust, Sequence

PRESET = "fast"
STEPS = 400
_VIEWS = 4
"""That are timed: each takes half a second."""
NOISE_DEG = 5.0
"""About each axis of each joint, in each frame by itself."""
_PATCH_PX = 20
"""As in the paper."""
_RESIDUAL = _REFINER = MlpSize(depth=2, width=64)
Change = Callable[[FieldSettings], FieldSettings]


@dataclass(frozen=True)
class FieldRung:
    """One way to train a field."""

    name: str
    settings: Change = lambda settings: settings
    poses_off: bool = False
    """Poses are noisy and count as estimated."""
    backbone: Path | None = None
    """Of a perceptual loss."""
    seeds: tuple[int, ...] = (0,)
    real_alone: bool = False
    """Where poses are exact there is nothing to refine."""
    group: str = "field"

    def fits(self, *, real: bool) -> bool:
        """Whether this is of use for a clip: poses of a real one are off as they are."""
        return not self.poses_off if real else not self.real_alone

    def clip(self, clip: Sequence) -> Sequence:
        """What is trained on."""
        return _with_poses_off(clip) if self.poses_off else clip


def measured_field(
    rung: FieldRung, seed: int, steps: int, filmed: Filmed, clock: Clock
) -> dict[str, Any]:
    """A field trained so: what it costs, and how near it comes to the truth."""
    preset = find_preset(PRESET)
    changed = replace(preset, settings=rung.settings(preset.field_settings))
    began = clock.now()
    model = train(
        rung.clip(filmed.clip),
        preset=changed,
        iterations=steps,
        seed=seed,
        lpips_backbone=rung.backbone,
        clock=clock.now,
    )
    training_s = clock.now() - began
    return {
        "training_s": round(training_s, 2),
        **costs(model, clock, _VIEWS),
        **filmed.judged(model),
    }


def _with_poses_off(clip: Sequence) -> Sequence:
    motion = noisy(clip.motion, NOISE_DEG, np.random.default_rng(0), lasting=False)
    frames = frames_of(clip.train, range(len(clip.train)))
    train = FrameList(
        tuple(replace(frame, pose=motion.pose(index)) for index, frame in enumerate(frames))
    )
    return replace(clip, train=train, motion=motion, pose_trust=PoseTrust.ESTIMATED)


def _set(**changes: Any) -> Change:
    return lambda settings: replace(settings, **changes)


def _sized(change: Callable[[FieldSizes], FieldSizes]) -> Change:
    return lambda settings: replace(settings, sizes=change(settings.sizes))


def _size(name: str, **changes: Any) -> FieldRung:
    return FieldRung(name, _sized(lambda sizes: replace(sizes, **changes)))


def _on_grid(name: str, **changes: Any) -> FieldRung:
    def changed(sizes: FieldSizes) -> FieldSizes:
        assert sizes.grid is not None
        return replace(sizes, grid=replace(sizes.grid, **changes))

    return FieldRung(name, _sized(changed))


def _bare(sizes: FieldSizes) -> FieldSizes:
    """The grid's features are the colour: they are then three."""
    grid: GridSize | None = sizes.grid
    assert grid is not None
    return replace(sizes, colour=None, grid=replace(grid, channels=3))


_PATCHES = FieldRung("patches of 20 px", _set(patch_px=_PATCH_PX, rays_a_frame=_PATCH_PX**2))
FIELD_AS_IT_IS = FieldRung("as it is", seeds=(0, 1))
FIELD_LADDER = (
    FIELD_AS_IT_IS,
    FieldRung("no MLP, colour from the grid", _sized(_bare)),
    _size("MLP 1 x 4", colour=MlpSize(depth=1, width=4)),
    _size("MLP 1 x 64", colour=MlpSize(depth=1, width=64)),
    _size("MLP 3 x 16", colour=MlpSize(depth=3, width=16)),
    _on_grid("voxels of 32 mm", voxel_m=0.032),
    _on_grid("voxels of 16 mm", voxel_m=0.016),
    _on_grid("voxels of 4 mm", voxel_m=0.004),
    _on_grid("1 channel", channels=1),
    _on_grid("16 channels", channels=16),
    *(_size(f"{count} samples a ray", samples_a_ray=count) for count in (8, 32, 128)),
    *(_size(f"weight volume {side} a side", volume=(side,) * 3) for side in (8, 16, 32, 64)),
    _size("residual on", residual=_RESIDUAL),
    *(FieldRung(f"pictures of {side} px", _set(most_px=side)) for side in (64, 128)),
    _PATCHES,
    replace(_PATCHES, name="patches of 20 px, LPIPS", backbone=PACKAGED_BACKBONE),
    replace(_size("refiner on", refiner=_REFINER), real_alone=True),
    FieldRung("poses off", poses_off=True),
    replace(_size("poses off, refiner on", refiner=_REFINER), poses_off=True),
    replace(_size("poses off, residual on", residual=_RESIDUAL), poses_off=True),
)
