"""Five performers with names, so that figures of different runs are of the same person.

They differ in build, skin and clothes, and in the clip of the CMU motion capture database that they
move by: dancing, walking, reaching, washing; all three skeleton families. The clips are no part of
this package: callers pass the folder that holds them.
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


def seed_of_performer(performer: str) -> int:
    """The seed of `performer`. Raises CaptureError for an unknown name."""
    if performer not in NAMED_PERFORMERS:
        raise CaptureError(
            f"performer must be one of {', '.join(NAMED_PERFORMERS)}; got {performer!r}"
        )
    return NAMED_PERFORMERS[performer].seed


def motion_file_of(motion: Path, performer: str | None) -> Path:
    """The motion file: `motion` itself, or the performer's own clip in the folder `motion`.

    Raises CaptureError for a folder without the clip, or without a performer to choose it.
    """
    if not motion.is_dir():
        return motion
    if performer is None:
        raise CaptureError(
            "motion must be a .bvh file unless a performer of "
            f"{', '.join(NAMED_PERFORMERS)} is named; got {motion}"
        )
    clip = motion / f"{NAMED_PERFORMERS[performer].clip}.bvh"
    if not clip.exists():
        raise CaptureError(f"motion must hold {clip.name}, {performer}'s clip; got {motion}")
    return clip
