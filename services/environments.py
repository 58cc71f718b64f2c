"""Places that a meeting can be held in, and their light: themes, and what a host brings along."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from capture.sources.archive import decode_picture
from db.errors import NotFound
from db.models import PanoramaRow
from db.repositories import UnitOfWork
from scene.arrays import Array, Float
from scene.colour import to_linear, to_srgb
from scene.environment import Environment
from scene.lighting import Lighting
from services.uploads.apart import read_panorama_apart

THEMES = Path(__file__).parent / "assets" / "themes"
STUDIO = "studio"
"""The theme of a meeting whose host chose none: a plain room that leaves everybody's light."""


_WIDEST_PX = 2048
"""Of a panorama that is kept; a viewer sees a twelfth of it at once."""
_JPEG_QUALITY = 88
_FIELDS = ("harmonics", "key_direction", "key_colour")
"""Of a `Lighting`, as they are stored."""


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
        lighting = Lighting(*(np.array(about[field]) for field in _FIELDS))
        found[name] = Theme(name, about["title"], lighting, THEMES / f"{name}.jpg")
    return found


def find_theme(name: str) -> Theme:
    """The theme of this name. Raises NotFound where there is none."""
    if name not in themes():
        known = ", ".join(themes())
        raise NotFound(f"environment must be one of {known}; got {name!r}")
    return themes()[name]


@cache
def environment(name: str) -> Environment:
    """The surroundings that a theme stands for, read once. Raises NotFound."""
    theme = find_theme(name)
    if theme.picture is None:
        return Environment(theme.name)
    panorama = _panorama(theme.name, theme.picture.read_bytes())
    return Environment(theme.name, panorama=panorama, lighting=theme.lighting)


def brought_along(meeting_id: str, picture: bytes) -> PanoramaRow:
    """The place that an equirectangular picture (JPEG, PNG) shows, exposed for people.

    It is decoded in a process of its own; what is stored was encoded here, of its pixels.

    Raises UnreadableClip for what is no picture or too large a one, InvalidInput for one that isn't
    twice as wide as high, or black.
    """
    seen = read_panorama_apart(picture, _WIDEST_PX)
    place = Environment.of_panorama("", to_linear(seen / 255.0))
    assert place.panorama is not None
    assert place.lighting is not None
    exposed = (to_srgb(place.panorama)[..., ::-1] * 255.0 + 0.5).astype(np.uint8)
    quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    stored = cv2.imencode(".jpg", np.ascontiguousarray(exposed), quality)[1].tobytes()
    name = f"own-{hashlib.sha256(stored).hexdigest()[:16]}"
    return PanoramaRow(
        meeting_id=meeting_id, name=name, picture=stored, light=_as_json(place.lighting)
    )


def environment_in(unit: UnitOfWork, meeting_id: str) -> Environment:
    """The surroundings of a meeting. Raises NotFound."""
    name = unit.meetings.get(meeting_id).environment
    own = unit.meetings.panorama(meeting_id)
    if own is not None and own.name == name:
        picture = unit.meetings.panorama_picture(meeting_id)
        assert picture is not None
        return Environment(name, panorama=_panorama(name, picture), lighting=light_of(own))
    # a theme that an older release had: the plain room
    return environment(name if name in themes() else STUDIO)


def light_of(own: PanoramaRow) -> Lighting:
    """The light of a place that a host brought along."""
    return Lighting(*(np.array(own.light[name]) for name in _FIELDS))


def _as_json(lighting: Lighting) -> dict[str, Any]:
    return {name: np.round(getattr(lighting, name), 5).tolist() for name in _FIELDS}


def _panorama(name: str, picture: bytes) -> Float[Array, "H W 3"]:
    """Linear radiance of a stored picture."""
    return to_linear(decode_picture(name, picture).astype(np.float32) / 255.0).astype(np.float32)
