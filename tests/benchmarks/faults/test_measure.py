"""Parts of a small service are killed for real, and nothing may be lost."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.faults.house import a_house
from benchmarks.faults.measure import FAULTS, strike_all
from benchmarks.faults.work import Film, Ledger
from benchmarks.load.crowd import gathered
from tests.services.jobs.waiting import until

KILLED = ("the training's process is killed", "the gateway is killed", "a renderer is killed")


def test_what_is_killed_loses_nothing_and_comes_back(monkeypatch: pytest.MonkeyPatch):
    # a training that gives way to all else never ends on a machine that does much else
    monkeypatch.setenv("METANERF_JOB_NICENESS", "0")
    rows = strike_all([one for one in FAULTS if one.name in KILLED], deployed=False)
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


def test_people_meet_on_one_gateway_and_go_on_together_when_it_is_drained():
    """No balancer is sticky here: the two ask different gateways first."""
    with a_house(deployed=False) as house:
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


def test_what_is_lost_is_told(tmp_path: Path):
    with a_house(deployed=False) as house:
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
