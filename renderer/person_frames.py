"""Frames of a clip that show somebody: those in which nobody was found teach only emptiness."""

from __future__ import annotations

from collections.abc import Iterable

from renderer.errors import TrainingError


def frames_with_person(shown: Iterable[bool]) -> list[int]:
    """Indices of the frames that a model can learn from.

    Args:
        shown: of each frame, whether its mask has anything in it.

    Raises TrainingError where none has.
    """
    frames = list(shown)
    found = [index for index, somebody in enumerate(frames) if somebody]
    if not found:
        raise TrainingError(
            f"at least one frame must show the person; got {len(frames)} frames whose masks are "
            "all empty; look at the clip's masks, or film against a plain, well lit background"
        )
    return found
