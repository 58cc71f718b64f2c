"""Frames of a clip that show somebody: those in which nobody was found teach only emptiness."""

from __future__ import annotations

from collections.abc import Iterable

from renderer.errors import TrainingError

LEAST_FRAMES = 2
"""Of one picture a model would be a guess: nothing tells the person from the pose."""


def frames_with_person(shown: Iterable[bool]) -> list[int]:
    """Indices of the frames that a model can learn from.

    Args:
        shown: of each frame, whether its mask has anything in it.

    Raises TrainingError where fewer than `LEAST_FRAMES` have.
    """
    frames = list(shown)
    found = [index for index, somebody in enumerate(frames) if somebody]
    if len(found) < LEAST_FRAMES:
        raise TrainingError(
            f"at least {LEAST_FRAMES} frames must show the person; got {len(found)} of "
            f"{len(frames)}, and empty masks in the others; look at the clip's masks, or film for "
            "10 seconds or more against a plain, well lit background"
        )
    return found
