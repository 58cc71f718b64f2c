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
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.faults.house import DISK_BYTES, House, a_house
from benchmarks.faults.spectator import Spectator, looking_on
from benchmarks.faults.work import Film, Ledger, Work
from benchmarks.load.crowd import Crowd, gathered
from benchmarks.reporting.figures import FigureWriter
from benchmarks.service import metric

MEETINGS, PEOPLE = 1, 3
_AWAY_S = 5.0
"""Before what does not start by itself is mended."""
_DRAINED_S = 60.0
_COMPILED_S = 600.0
SETTLED_S = 2.0
_WARM = r'metanerf_renderers\{state="warm"\}'
"""The figure of renderers that wait, as `metric` looks for it."""
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
    drawn: bool = False
    """Whether what counts is what somebody sees for whom the server draws."""


def _kill_child(house: House, crowd: Crowd, work: Work) -> None:
    os.kill(_child_of(work.job_id), signal.SIGKILL)


def _kill_renderer(house: House, crowd: Crowd, work: Work) -> None:
    """Of the gateway's, the one that draws: it has worked most."""
    gateways = {house.gateway.process_id, house.spare.process_id}
    renderers = _processes(b"services.live.rendering.child")
    found = [one for one in renderers if int(_state(one)[1]) in gateways]
    os.kill(max(found, key=_worked), signal.SIGKILL)


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
    Fault("a renderer is killed", _kill_renderer, deployed=False, drawn=True),
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
    with a_house(deployed=deployed) as house:
        return strike_in(house, faults)


def strike_in(house: House, faults: Sequence[Fault]) -> list[dict[str, Any]]:
    """What became of everything in `house` at each of `faults`."""
    with tempfile.TemporaryDirectory() as folder:
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
                with ExitStack() as stack:
                    eyes = stack.enter_context(_eyes(house, crowd)) if fault.drawn else None
                    work = Work(ledger, film, number)
                    rows.append(_struck(fault, house, crowd, work, ledger, eyes))
            return rows


def _struck(
    fault: Fault,
    house: House,
    crowd: Crowd,
    work: Work,
    ledger: Ledger,
    eyes: Spectator | None,
) -> dict[str, Any]:
    """`eyes`: of whom counts for how long nobody moves, if not of everybody."""
    work.under_way()
    crowd.collect()
    if eyes is not None:
        _until_settled(house, eyes)
        eyes.collect()
    began = time.monotonic()
    fault.strike(house, crowd, work)
    time.sleep(fault.away_s)
    fault.mend(house)
    crowd.wait()
    moving_s = time.monotonic() - began
    ended = work.end()
    time.sleep(SETTLED_S)
    seen = crowd.collect()
    gaps_s = seen.longest_gaps_s if eyes is None else [eyes.collect()]
    row = {
        "fault": fault.name,
        "mended_after_s": fault.away_s,
        "still_s": round(max(gaps_s), 2),
        "still_least_s": round(min(gaps_s), 2),
        "back_s": round(moving_s, 1),
        "answers": dict(seen.answers),
        **ended,
        "lost": ledger.lost(),
        "kept": len(ledger.kept),
    }
    print(row, flush=True)
    return row


def _eyes(house: House, crowd: Crowd) -> AbstractContextManager[Spectator]:
    return looking_on(house.host.address, house.host.token, crowd.meeting_ids[0])


def _until_settled(house: House, eyes: Spectator) -> None:
    """Return once the spectator sees somebody move, and a renderer waits beside the one that
    draws, as after some seconds it always does."""
    deadline = time.monotonic() + _COMPILED_S
    while not (eyes.sees and metric(f"{house.host.address}/", _WARM) > 0.0):
        if time.monotonic() > deadline:
            raise RuntimeError("a spectator must see somebody move; got one who does not")
        time.sleep(0.5)


def _child_of(job_id: str) -> int:
    """The id of the process that runs a job."""
    for process_id in _processes(b"services.jobs.child", job_id.encode()):
        return process_id
    raise RuntimeError(f"job {job_id} must have a process; got none")


def _processes(*wanted: bytes) -> Iterator[int]:
    """Ids of those on whose command line these words stand."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:  # it has ended meanwhile
            continue
        if set(wanted) <= set(words):
            yield int(folder.name)


def _worked(process_id: int) -> int:
    """Ticks of a processor that a process has taken."""
    state = _state(process_id)
    return int(state[11]) + int(state[12])


def _state(process_id: int) -> list[str]:
    """What Linux tells of a process after its name (proc_pid_stat(5))."""
    return Path(f"/proc/{process_id}/stat").read_text().rpartition(") ")[2].split()
