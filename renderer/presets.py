"""What can be trained, by name: a kind of model, and for the paper's fields any speed-ups after it.

`paper+cull+early-stop` is the preset `paper` with two speed-ups. An exact one makes the same
pictures from the same weights (at least 50 dB between them); the others say what they cost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from renderer.errors import UnknownPreset
from renderer.field.settings import FAST, HUMANNERF, PAPER, FieldSettings
from renderer.field.sizes import FieldSizes, GridSize, MlpSize
from renderer.splats.settings import SplatSettings
from scene.errors import InvalidInput


@dataclass(frozen=True)
class Preset:
    """A kind of model and its sizes."""

    name: str
    description: str
    settings: SplatSettings | FieldSettings = field()

    @property
    def is_field(self) -> bool:
        """Whether it trains a neural field, not splats."""
        return isinstance(self.settings, FieldSettings)

    @property
    def field_settings(self) -> FieldSettings:
        """The settings of a field. Raises InvalidInput where the preset trains splats."""
        if isinstance(self.settings, FieldSettings):
            return self.settings
        raise InvalidInput(f"preset must be a field's; got {self.name!r}; choose 'fast' or 'paper'")

    @property
    def trains_on_patches(self) -> bool:
        """Whether it can learn from a perceptual loss, which looks at patches."""
        return self.is_field and self.field_settings.patch_px > 0


@dataclass(frozen=True)
class SpeedUp:
    """What a suffix adds to one of the paper's fields."""

    description: str
    exact: bool
    """Whether pictures stay the same, given the same weights."""
    apply: Callable[[FieldSizes], FieldSizes]


def _on_a_grid(sizes: FieldSizes) -> FieldSizes:
    assert sizes.colour is not None
    return replace(
        sizes,
        colour=MlpSize(depth=2, width=64, bias=sizes.colour.bias),
        octaves=0,
        grid=GridSize(voxel_m=0.008, channels=4, inside_m=0.03, outside_m=0.04),
        bone_prior=False,
    )


SPEED_UPS: dict[str, SpeedUp] = {
    "cull": SpeedUp(
        "samples that no bone reaches are skipped, and bones are asked only where they reach",
        True,
        lambda sizes: replace(sizes, cull=True),
    ),
    "posed-grid": SpeedUp(
        "a 64^3 grid a frame in place of 24 look-ups a sample: seams between limbs blur a little",
        False,
        lambda sizes: replace(sizes, posed_grid=64),
    ),
    "occupancy": SpeedUp(
        "samples are skipped where the trained canonical space is empty",
        True,
        lambda sizes: replace(sizes, occupancy=True),
    ),
    "early-stop": SpeedUp(
        "rays end where nothing behind can be seen",
        True,
        lambda sizes: replace(sizes, early_stop=True),
    ),
    "grid": SpeedUp(
        "a grid of features in a shell round the skin before an MLP of 2 x 64 takes the place of "
        "the deep canonical MLP: a larger file, other weights, and nothing beyond the shell",
        False,
        _on_a_grid,
    ),
    "baked": SpeedUp(
        "a trained model keeps its weight volume and drops the CNN that made it",
        True,
        lambda sizes: replace(sizes, baked=True),
    ),
}
EXACT = tuple(name for name, speed_up in SPEED_UPS.items() if speed_up.exact)

_BASES = (
    Preset(
        "splats",
        "skinned Gaussian splats: seconds to train, milliseconds a view, what meetings draw",
        SplatSettings(),
    ),
    Preset(
        "fast",
        "the paper's field on a grid in a shell with a small MLP: sized for two CPU cores",
        FAST,
    ),
    Preset(
        "humannerf",
        "HumanNeRF's own networks and schedule (150K iterations): the baseline, for a GPU",
        HUMANNERF,
    ),
    Preset(
        "paper",
        "the same depths, 64 wide, as fully fused networks: the paper's, for a GPU",
        PAPER,
    ),
)
_WITH_SPEED_UPS = ("humannerf", "paper")


def _with(base: Preset, names: tuple[str, ...]) -> Preset:
    """`base` with speed-ups, named in their own order."""
    ordered = [name for name in SPEED_UPS if name in names]
    sizes = base.field_settings.sizes
    for name in ordered:
        sizes = SPEED_UPS[name].apply(sizes)
    added = "; ".join(SPEED_UPS[name].description for name in ordered)
    settings = replace(base.field_settings, sizes=sizes)
    return Preset("+".join([base.name, *ordered]), f"{base.name}, where {added}", settings)


def _listed() -> dict[str, Preset]:
    """The bases, each speed-up alone, and all exact ones together."""
    presets = list(_BASES)
    for base in _BASES:
        if base.name in _WITH_SPEED_UPS:
            presets += [_with(base, (name,)) for name in SPEED_UPS]
            presets.append(_with(base, EXACT))
    return {preset.name: preset for preset in presets}


PRESETS: dict[str, Preset] = _listed()


def find_preset(name: str) -> Preset:
    """The preset `name`, perhaps with speed-ups after a plus sign each.

    Raises UnknownPreset that lists what there is.
    """
    first, *added = name.split("+")
    bases = {preset.name: preset for preset in _BASES}
    if first not in bases:
        raise UnknownPreset(f"preset must be one of {', '.join(bases)}; got {name!r}")
    if not added:
        return bases[first]
    if first not in _WITH_SPEED_UPS:
        raise UnknownPreset(
            f"speed-ups must follow one of {', '.join(_WITH_SPEED_UPS)}; got {name!r}; "
            f"use {first!r} as it is"
        )
    if not set(added) <= set(SPEED_UPS):
        raise UnknownPreset(f"speed-ups must be among {', '.join(SPEED_UPS)}; got {name!r}")
    return _with(bases[first], tuple(added))
