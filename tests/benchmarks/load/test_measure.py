"""Synthetic people in real meetings of a real server."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.load import measure
from benchmarks.load.crowd import gathered
from benchmarks.load.gateways import several_gateways
from benchmarks.load.host import Host, host_at, warm_up
from benchmarks.load.measure import LoadEffort, measured, overload
from benchmarks.service import metric
from scene.errors import InvalidInput
from services.bootstrap import DEMO_MODEL, ensure_demo
from tests.e2e.serving import serving


@pytest.fixture
def soon_settled(monkeypatch: pytest.MonkeyPatch) -> None:
    """So few people need less time until all comes regularly."""
    monkeypatch.setattr(measure, "SETTLING_S", 1.0)


@pytest.mark.e2e  # nothing else may run beside it: it counts what came too late
def test_every_motion_comes_to_every_viewer(tmp_path: Path):
    with serving(tmp_path, max_viewers=6) as gateway:
        ensure_demo(gateway.services, DEMO_MODEL, "Ada")
        host = host_at(gateway.address, None, None)
        warm_up(host)
        row = measured(host, 2, 3, 2.0, 2)
    assert row["motions_sent_per_second"] > 30
    assert row["poses_per_second"] > row["motions_sent_per_second"]
    assert row["lost_share"] < 0.05
    assert 0.0 < row["relay_p50_ms"] <= row["relay_p95_ms"] <= row["relay_p99_ms"]
    assert row["rate_slowest"] > 5
    assert row["generator_cores"] > 0.0
    assert row["server_cores"] > 0.0


@pytest.mark.usefixtures("soon_settled")
def test_meetings_spread_over_several_gateways():
    with several_gateways(2, most_people=8) as host:
        meetings, people = 4, 2
        with gathered(host.plan(meetings, people), 1):
            held = [metric(f"{address}/", "metanerf_viewers") for address in host.addresses]
        row = measured(host, 2, 2, 2.0, 1)
    assert sum(held) == meetings * people
    assert min(held) > 0
    assert row["rate_slowest"] > 5
    assert row["server_cores"] > 0.0


@pytest.fixture(scope="module")
def small_host(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Host]:
    """A server with two places."""
    with serving(tmp_path_factory.mktemp("small"), max_viewers=2) as gateway:
        ensure_demo(gateway.services, DEMO_MODEL, "Ada")
        host = host_at(gateway.address, None, None)
        warm_up(host)
        yield host


@pytest.mark.usefixtures("soon_settled")
def test_whoever_finds_no_place_is_told_when_to_come_back(small_host: Host):
    row = overload(small_host, 1, 2, LoadEffort(seconds=2.0))
    assert set(row["answers"]) == {"503 Retry-After"}
    assert row["rate_slowest_during"] > 5


def test_a_server_without_a_place_for_everybody_is_told(small_host: Host):
    plan = replace(small_host.plan(1, 3), patience_s=3.0)
    told = r"within 3 s; got 1 of 3 who were not, .*503 Retry-After"
    with pytest.raises(InvalidInput, match=told), gathered(plan, 1):
        pass


def test_the_largest_number_is_found_between_one_that_holds_and_one_that_does_not(
    monkeypatch: pytest.MonkeyPatch,
):
    tried: list[int] = []

    def fake(host: object, meetings: int, *_: object) -> dict:
        tried.append(meetings)
        late = 20.0 if meetings <= 11 else 90.0
        return {"meetings": meetings, "relay_p95_ms": late, "lost_share": 0.0, "rate_slowest": 29.0}

    monkeypatch.setattr(measure, "measured", fake)
    found, rows = measure.largest(None, 4, LoadEffort())  # type: ignore[arg-type]
    assert found == 11
    assert tried == [1, 2, 4, 8, 16, 12, 10, 11]
    assert [row["holds"] for row in rows] == [one <= 11 for one in tried]
    tried.clear()
    assert measure.largest(None, 4, LoadEffort(most_meetings=8))[0] == 8  # type: ignore[arg-type]
