"""What people of a load test count."""

from __future__ import annotations

from collections import Counter

from benchmarks.load.measure import holds
from benchmarks.load.tally import Tally


def tally(relay_s: list[float], expected: int, rate: float) -> Tally:
    made = Tally(relay_s=relay_s, sent=30, received=90, expected=expected, bytes_received=125_000)
    made.viewer_rates, made.longest_gaps_s = [rate], [0.1 * rate]
    made.answers = Counter({"201": 1})
    return made


def test_what_processes_counted_comes_together():
    parts = [tally([0.010] * 90, 90, 30.0), tally([0.030] * 10, 100, 20.0)]
    figures = Tally.sum(parts).figures(2.0)
    assert (figures["relay_p50_ms"], figures["relay_p95_ms"]) == (10.0, 30.0)
    assert (figures["motions_sent_per_second"], figures["poses_per_second"]) == (30.0, 90.0)
    assert figures["down_mbit_s"] == 1.0
    assert figures["lost_share"] == round(10 / 190, 4)
    assert (figures["rate_mean"], figures["rate_slowest"]) == (25.0, 20.0)
    assert figures["longest_gap_s"] == 3.0
    assert figures["answers"] == {"201": 2}


def test_where_nothing_comes_nothing_holds():
    figures = Tally().figures(1.0)
    assert figures["relay_p95_ms"] is None
    assert not holds(figures)


def test_meetings_hold_where_motion_is_soon_whole_and_fluent():
    good = {"relay_p95_ms": 49.9, "lost_share": 0.0, "rate_slowest": 29.0}
    assert holds(good)
    for worse in ({"relay_p95_ms": 50.0}, {"lost_share": 0.02}, {"rate_slowest": 22.0}):
        assert not holds(good | worse)
