"""Performers with names, so that figures of different runs are of the same person.

Five are painted; eight are lifelike, of MakeHuman's skins and garments. They differ in build, skin
and clothes, and in the clip of the CMU motion capture database that they move by: dancing, walking,
reaching, washing; all three skeleton families. Neither clips nor assets are part of this package:
callers pass the folders that hold them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from capture.errors import CaptureError


@dataclass(frozen=True)
class NamedPerformer:
    """A performer with a fixed appearance and motion."""

    seed: int
    """Of shape and clothes; never changed, or older figures would be of another person."""
    clip: str
    """Stem of their motion file."""


NAMED_PERFORMERS = {
    "amber": NamedPerformer(2, "dance_turn_on_spot_94_14"),
    "basil": NamedPerformer(6, "walk_figure8_91_62"),
    "clover": NamedPerformer(9, "bend_scoop_lift_arm_02_06"),
    "dune": NamedPerformer(11, "wash_self_02_10"),
    "ember": NamedPerformer(14, "dance_indian_94_15"),
}


@dataclass(frozen=True)
class LifelikePerformer(NamedPerformer):
    """A performer made of MakeHuman's assets."""

    tone: str
    """Of the skin: `light` or `dark`."""
    age: str
    """Of the skin: `young` or `middle-aged`."""
    skin: str
    """Stem of the picture in `skins/textures`."""
    hair: str
    """Folder in `hair`; empty: none but the scalp's stubble."""
    garments: tuple[str, ...]
    """Folders in `clothes`."""
    eyes: str
    """Stem of the material in `eyes/materials`."""
    brows: str
    """Folder in `eyebrows`."""
    shape: tuple[float, float, float, float, float]
    """Of the body model, see `capture.body.model.SHAPE_NAMES`; ages differ in build alone."""


# fmt: off
LIFELIKE_PERFORMERS = {
    "fern": LifelikePerformer(
        31, "dance_turn_on_spot_94_14", "light", "young", "young_lightskinned_female_diffuse2",
        "ponytail01", ("female_sportsuit01", "shoes06"), "green", "eyebrow010",
        (-0.02, -0.08, -0.4, 0.1, 0.1)),
    "flint": LifelikePerformer(
        32, "walk_figure8_91_62", "dark", "young", "young_darkskinned_male_diffuse",
        "short01", ("male_casualsuit06", "shoes05"), "brownlight", "eyebrow001",
        (0.06, -0.05, 0.4, 0.25, 0.1)),
    "hazel": LifelikePerformer(
        33, "wash_self_02_10", "light", "middle-aged", "middleage_lightskinned_female_diffuse2",
        "bob02", ("female_casualsuit01", "shoes02"), "blue", "eyebrow002",
        (-0.05, 0.15, -0.4, -0.1, 0.0)),
    "jasper": LifelikePerformer(
        34, "dance_indian_94_15", "light", "young", "young_lightskinned_male_diffuse",
        "short02", ("male_casualsuit03", "shoes01"), "grey", "eyebrow003",
        (0.02, -0.12, 0.35, 0.0, 0.05)),
    "moss": LifelikePerformer(
        35, "walk_figure8_91_62", "dark", "middle-aged", "middleage_darkskinned_male_diffuse",
        "short04", ("male_elegantsuit01", "shoes03"), "brownlight", "eyebrow008",
        (0.0, 0.2, 0.4, 0.05, 0.0)),
    "reed": LifelikePerformer(
        36, "bend_scoop_lift_arm_02_06", "light", "middle-aged",
        "middleage_lightskinned_male_diffuse", "", ("male_worksuit01", "shoes02"), "lightblue",
        "eyebrow012", (-0.02, 0.2, 0.4, 0.1, -0.1)),
    "slate": LifelikePerformer(
        37, "wash_self_02_10", "light", "young", "young_lightskinned_male_diffuse3",
        "short01", ("male_casualsuit02", "shoes04"), "brownlight", "eyebrow004",
        (0.05, 0.05, 0.4, 0.3, 0.1)),
    "thorn": LifelikePerformer(
        38, "dance_turn_on_spot_94_14", "light", "middle-aged",
        "middleage_lightskinned_male_diffuse2", "short04", ("male_casualsuit04", "shoes05"),
        "ice", "eyebrow009", (-0.04, 0.25, 0.35, -0.1, -0.05)),
}
# fmt: on
_ALL: dict[str, NamedPerformer] = {**NAMED_PERFORMERS, **LIFELIKE_PERFORMERS}


def seed_of_performer(performer: str) -> int:
    """The seed of `performer`. Raises CaptureError for an unknown name."""
    if performer not in _ALL:
        raise CaptureError(f"performer must be one of {', '.join(_ALL)}; got {performer!r}")
    return _ALL[performer].seed


def motion_file_of(motion: Path, performer: str | None) -> Path:
    """The motion file: `motion` itself, or the performer's own clip in the folder `motion`.

    Raises CaptureError for a folder without the clip, or without a performer to choose it.
    """
    if not motion.is_dir():
        return motion
    if performer is None:
        raise CaptureError(
            "motion must be a .bvh file unless a performer of "
            f"{', '.join(_ALL)} is named; got {motion}"
        )
    clip = motion / f"{_ALL[performer].clip}.bvh"
    if not clip.exists():
        raise CaptureError(f"motion must hold {clip.name}, {performer}'s clip; got {motion}")
    return clip
