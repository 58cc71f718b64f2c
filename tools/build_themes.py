"""Makes the bundled themes: `python -m tools.build_themes FOLDER` (seconds, one core).

FOLDER holds Radiance .hdr panoramas of Poly Haven (CC0; see NOTICE). A theme is a picture of the
place, as a viewer sees it, and the light of the panorama, which the picture no longer holds.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from capture.sources.panorama import read_panorama
from scene.arrays import Array
from scene.colour import to_srgb
from scene.environment import Environment
from services.environments import THEMES

_SOURCES = {
    "apartment": ("Apartment", "living_room_apartment_1024x512.hdr"),
    "lobby": ("Lobby", "office_lobby_896x448.hdr"),
    "park": ("Park", "outdoor_park_896x448.hdr"),
}
_JPEG_QUALITY = 88


def build(
    folder: Annotated[Path, typer.Argument(help="Panoramas (.hdr).")],
    out: Annotated[Path, typer.Option()] = THEMES,
) -> None:
    """Write a picture and the light of every theme."""
    out.mkdir(parents=True, exist_ok=True)
    about = {}
    for name, (title, file) in _SOURCES.items():
        made = Environment.of_panorama(name, read_panorama(folder / file))
        assert made.panorama is not None
        assert made.lighting is not None
        seen = (to_srgb(made.panorama)[..., ::-1] * 255.0 + 0.5).astype(np.uint8)
        quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        (out / f"{name}.jpg").write_bytes(cv2.imencode(".jpg", seen, quality)[1].tobytes())
        about[name] = {
            "title": title,
            "harmonics": _rounded(made.lighting.harmonics),
            "key_direction": _rounded(made.lighting.key_direction),
            "key_colour": _rounded(made.lighting.key_colour),
        }
    (out / "themes.json").write_text(json.dumps(about, indent=1) + "\n")


def _rounded(values: Array) -> list:
    return np.round(values, 5).tolist()


if __name__ == "__main__":
    typer.run(build)
