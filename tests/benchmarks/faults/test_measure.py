"""Parts of a small service are killed for real, and nothing may be lost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.faults import measure, work
from benchmarks.faults.house import House, a_house
from benchmarks.faults.measure import FAULTS, strike_in
from benchmarks.faults.work import Film, Ledger
from benchmarks.load.crowd import gathered
from tests.services.jobs.waiting import until

KILLED = ("the training's process is killed", "the gateway is killed", "a renderer is killed")


@pytest.fixture(scope="module")
def house() -> Iterator[House]:
    with pytest.MonkeyPatch.context() as patch:
        # a training that gives way to all else never ends on a machine that does much else
        patch.setenv("METANERF_JOB_NICENESS", "0")
        with a_house(deployed=False) as one:
            yield one


def test_what_is_killed_loses_nothing_and_comes_back(house: House, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(work, "BUDGET_S", 3.0)
    monkeypatch.setattr(work, "PIECE_PAUSE_S", 0.5)
    monkeypatch.setattr(measure, "SETTLED_S", 0.5)
    rows = strike_in(house, [one for one in FAULTS if one.name in KILLED])
    assert [row["fault"] for row in rows] == list(KILLED)
    for row in rows:
        assert row["lost"] == []
        assert (row["job"], row["upload"]) == ("succeeded", "whole")
        assert not row["job_resumed_by_hand"]
        assert row["psnr"] > 15.0
    assert rows[0]["job_attempts"] == 2
    # the meeting does not notice a training's end; a gateway's it does, and goes on
    assert rows[0]["still_s"] < rows[1]["still_s"]
    assert rows[2]["kept"] == 6
    # it is pictures that were looked at there, and they came again
    assert rows[2]["still_s"] > 0.0


def test_people_meet_on_one_gateway_and_go_on_together_when_it_is_drained(house: House):
    """No balancer is sticky here: the two ask different gateways first."""
    house.start_gateways()
    plan = house.host.plan(meetings=1, people=2)
    plan = replace(plan, addresses=(house.host.address, house.spare_address), patience_s=300.0)
    with gathered(plan, 1) as crowd:
        crowd.meet()
        connections = Counter(crowd.collect().answers)
        drained = house.home_of(crowd.meeting_ids[0])
        drained.end(within_s=60.0)

        def anew() -> bool:
            connections.update(crowd.collect().answers)
            return connections["201"] >= 4

        until(anew, "new connections of both")
        crowd.meet()
        left = house.home_of(crowd.meeting_ids[0])
        assert left is not drained
        assert left.runs
        assert not drained.runs


def test_what_is_lost_is_told(house: House, tmp_path: Path):
    if not house.gateway.runs:
        house.gateway.start()
    film = Film.stored(house, tmp_path / "film")
    ledger = Ledger(house)
    path = f"/v1/sequences/{film.sequence_id}"
    with house.services.reading() as unit:
        row = unit.sequences.get(film.sequence_id)
    assert row.source_sha256 is not None
    ledger.kept[path] = row.source_sha256
    assert ledger.lost() == []
    ledger.kept["/v1/models/gone"] = "0" * 64
    house.services.objects.delete(film.person_id, row.source_sha256)
    assert ledger.lost() == ["/v1/models/gone", f"{film.person_id}/{row.source_sha256}"]
