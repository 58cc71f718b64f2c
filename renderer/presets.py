"""What can be trained, by name."""

from __future__ import annotations

from dataclasses import dataclass, field

from renderer.errors import UnknownPreset
from renderer.field.settings import FAST, FieldSettings
from renderer.splats.settings import SplatSettings


@dataclass(frozen=True)
class Preset:
    """A kind of model and its sizes."""

    name: str
    description: str
    settings: SplatSettings | FieldSettings = field()


PRESETS: dict[str, Preset] = {
    preset.name: preset
    for preset in (
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
    )
}


def find_preset(name: str) -> Preset:
    """The preset `name`. Raises UnknownPreset that lists what there is."""
    if name not in PRESETS:
        raise UnknownPreset(f"preset must be one of {', '.join(PRESETS)}; got {name!r}")
    return PRESETS[name]
