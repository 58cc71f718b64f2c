"""Parts of a service fail one after the other, while a meeting, an upload and a training go on.

Each fault is struck once the training has learnt something, and mended after a while: a process
that died is started again at once, as docker-compose.yml has it, a server or a line comes back
after some seconds. Then everything must come to its end: what was said to be kept is there, whole;
whoever is in the meeting sees people move again.
"""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.faults.house import DISK_BYTES, House, a_house
from benchmarks.faults.work import Film, Ledger, Work
from benchmarks.load.crowd import Crowd, gathered
from benchmarks.reporting.figures import FigureWriter

MEETINGS, PEOPLE = 1, 3
_AWAY_S = 5.0
"""Before what does not start by itself is mended."""
_DRAINED_S = 60.0
_COMPILED_S = 600.0
_SETTLED_S = 2.0
_MOVING_S = 60.0
"""Time in which everybody must see somebody move again."""


@dataclass(frozen=True)
class Fault:
    """One way of failing."""

    name: str
    strike: Callable[[House, Crowd, Work], None]
    """Given the crowd and the work that it is to disturb."""
    mend: Callable[[House], None] = lambda house: None
    away_s: float = 0.0
    """From the one to the other."""
    deployed: bool = True
    """Happens only to a service with servers behind it."""
    prepare: Callable[[House], None] = lambda house: None
    """Before anything goes on."""


def _kill_child(house: House, crowd: Crowd, work: Work) -> None:
    os.kill(_child_of(work.job_id), signal.SIGKILL)


def _cut_objects(house: House, *, cut: bool) -> None:
    assert house.objects is not None
    house.objects.cut_at = 0 if cut else None


Part = TypeVar("Part")


def _require(part: Part | None) -> Part:
    assert part is not None
    return part


FAULTS = (
    Fault("nothing", lambda house, crowd, work: None, deployed=False),
    Fault("the training's process is killed", _kill_child, deployed=False),
    Fault(
        "the training worker is killed",
        lambda house, crowd, work: house.worker.kill(),
        lambda house: house.worker.start(),
        deployed=False,
    ),
    Fault(
        "the gateway is killed",
        lambda house, crowd, work: house.gateway.kill(),
        lambda house: house.gateway.start(),
        deployed=False,
    ),
    Fault(
        "one of two gateways is killed",
        lambda house, crowd, work: house.home_of(crowd.meeting_ids[0]).kill(),
        House.start_gateways,
        _AWAY_S,
        prepare=House.start_gateways,
    ),
    Fault(
        "one of two gateways is drained",
        lambda house, crowd, work: house.home_of(crowd.meeting_ids[0]).end(_DRAINED_S),
        House.start_gateways,
        deployed=False,
        prepare=House.start_gateways,
    ),
    Fault(
        "everybody's network is cut",
        lambda house, crowd, work: crowd.cut(_AWAY_S),
        away_s=_AWAY_S,
        deployed=False,
    ),
    Fault(
        "Redis is killed",
        lambda house, crowd, work: _require(house.redis).kill(),
        lambda house: _require(house.redis).start(),
        _AWAY_S,
    ),
    Fault(
        "PostgreSQL is killed",
        lambda house, crowd, work: _require(house.postgres).kill(),
        lambda house: _require(house.postgres).start(),
        _AWAY_S,
    ),
    Fault(
        "the object store is cut off",
        lambda house, crowd, work: _cut_objects(house, cut=True),
        lambda house: _cut_objects(house, cut=False),
        _AWAY_S,
    ),
    Fault(
        "the disk is full",
        lambda house, crowd, work: _require(house.disk).leave(0),
        lambda house: _require(house.disk).resize(DISK_BYTES),
        _AWAY_S,
    ),
)


def run(writer: FigureWriter, *, quick: bool = False) -> None:
    """Strike every fault and report; `quick`: those of a service without servers behind it."""
    rows = strike_all([one for one in FAULTS if not (quick and one.deployed)], deployed=not quick)
    writer.write({"away_s": _AWAY_S, "people": PEOPLE, "rows": rows})


def strike_all(faults: Sequence[Fault], *, deployed: bool) -> list[dict[str, Any]]:
    """What became of everything at each of `faults`, in one service."""
    with tempfile.TemporaryDirectory() as folder, a_house(deployed=deployed) as house:
        film = Film.stored(house, Path(folder) / "film")
        ledger = Ledger(house)
        plan = house.host.plan(MEETINGS, PEOPLE)
        plan = replace(
            plan, addresses=(*plan.addresses, house.spare_address), patience_s=_COMPILED_S
        )
        with gathered(plan, 1) as crowd:
            rows = []
            for number, fault in enumerate(faults):
                fault.prepare(house)
                rows.append(_struck(fault, house, crowd, Work(ledger, film, number), ledger))
            return rows


def _struck(fault: Fault, house: House, crowd: Crowd, work: Work, ledger: Ledger) -> dict[str, Any]:
    work.under_way()
    crowd.collect()
    began = time.monotonic()
    fault.strike(house, crowd, work)
    time.sleep(fault.away_s)
    fault.mend(house)
    crowd.wait()
    moving_s = time.monotonic() - began
    ended = work.end()
    time.sleep(_SETTLED_S)
    seen = crowd.collect()
    row = {
        "fault": fault.name,
        "mended_after_s": fault.away_s,
        "still_s": round(max(seen.longest_gaps_s), 2),
        "still_least_s": round(min(seen.longest_gaps_s), 2),
        "back_s": round(moving_s, 1),
        "answers": dict(seen.answers),
        **ended,
        "lost": ledger.lost(),
        "kept": len(ledger.kept),
    }
    print(row, flush=True)
    return row


def _child_of(job_id: str) -> int:
    """The id of the process that runs a job."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:  # it has ended meanwhile
            continue
        if b"services.jobs.child" in words and job_id.encode() in words:
            return int(folder.name)
    raise RuntimeError(f"job {job_id} must have a process; got none")
