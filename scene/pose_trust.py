"""Where the poses of a sequence come from."""

from __future__ import annotations

from enum import StrEnum


class PoseTrust(StrEnum):
    """How far the poses of a sequence are believed."""

    EXACT = "exact"
    """They are known, from a studio or markers: nothing moves them."""
    GIVEN = "given"
    """They came with the data, by an estimator that may be some degrees off. They say how the
    person will be driven, so their skeleton and their means over the clip hold."""
    ESTIMATED = "estimated"
    """Our own capture found them, and the skeleton with them: all may be refined."""
