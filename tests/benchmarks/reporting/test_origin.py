"""What is written of the machine beside every figure."""

from __future__ import annotations

from benchmarks.reporting.checkout import Checkout
from benchmarks.reporting.origin import ORIGIN, origin_of


def test_an_origin_says_when_where_and_how_fast_a_machine() -> None:
    origin = origin_of(Checkout())
    assert tuple(origin) == ORIGIN
    assert origin["machine"]["loop_ms"] > 0.0
