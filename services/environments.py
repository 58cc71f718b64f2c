"""The library of themes: places that a meeting can be held in, and their light."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from scene.colour import to_linear
from scene.environment import Environment
from scene.lighting import Lighting
from services.problems import ProblemError

THEMES = Path(__file__).parent / "assets" / "themes"
STUDIO = "studio"
"""The theme of a meeting whose host chose none: a plain room that leaves everybody's light."""


@dataclass(frozen=True, eq=False)
class Theme:
    """One entry of the library."""

    name: str
    title: str
    lighting: Lighting | None
    picture: Path | None
    """Equirectangular, sRGB, JPEG; none of the plain studio."""


@cache
def themes() -> dict[str, Theme]:
    """Every theme by its name, the plain studio first."""
    stored = json.loads((THEMES / "themes.json").read_text())
    found = {STUDIO: Theme(STUDIO, "Studio", None, None)}
    for name, about in stored.items():
        lighting = Lighting(
            np.array(about["harmonics"]),
            np.array(about["key_direction"]),
            np.array(about["key_colour"]),
        )
        found[name] = Theme(name, about["title"], lighting, THEMES / f"{name}.jpg")
    return found


def find_theme(name: str) -> Theme:
    """The theme of this name. Raises a 404 problem where there is none."""
    if name not in themes():
        known = ", ".join(themes())
        raise ProblemError(404, "not-found", f"environment must be one of {known}; got {name!r}")
    return themes()[name]


@cache
def environment(name: str) -> Environment:
    """The surroundings that a theme stands for, read once. Raises a 404 problem."""
    theme = find_theme(name)
    if theme.picture is None:
        return Environment(theme.name)
    encoded = cv2.imdecode(np.frombuffer(theme.picture.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
    assert encoded is not None, f"{theme.picture} is broken; run services.build_themes"
    panorama = to_linear(encoded[..., ::-1].astype(np.float32) / 255.0).astype(np.float32)
    return Environment(theme.name, panorama=panorama, lighting=theme.lighting)
