"""How many meetings a server holds, and what becomes of those who are too many.

A number of meetings holds where motions come to their viewers within 50 ms (p95), three in four of
the 30 a second come to the slowest viewer, and at most one pose in a hundred is lost. That not all
come has a reason besides: people and server tick 30 times a second each, not in step, and where two
motions come within a tick the newer one is sent.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.load.crowd import Crowd, gathered
from benchmarks.load.gateways import several_gateways
from benchmarks.load.host import Host, Usage, own_host
from benchmarks.load.person import RATE_HZ
from benchmarks.reporting.figures import FigureWriter

HOLDS_MS, HOLDS_LOST, HOLDS_RATE = 50.0, 0.01, 0.75 * RATE_HZ
GOAL_MEETINGS, GOAL_PEOPLE = 15, 4
SETTLING_S = 4.0
_SAMPLE_S = 5.0
"""Between two looks at the server's memory."""
_LATE_MEETINGS = 2
"""That try to come in where all places are taken."""


@dataclass(frozen=True)
class LoadEffort:
    """How long and how hard is measured."""

    seconds: float = 20.0
    """Of each number of meetings."""
    memory_s: float = 600.0
    """Of the memory's slope."""
    most_meetings: int = 32
    processes: int = 1
    gateways: int = 2
    """On one machine, once what one holds is known."""


def measured(host: Host, meetings: int, people: int, seconds: float, processes: int) -> dict:
    """What comes of so many meetings of so many people on `host`, over `seconds`."""
    began = time.monotonic()
    with gathered(host.plan(meetings, people), processes) as crowd:
        gathered_s = time.monotonic() - began
        time.sleep(SETTLING_S)
        row = {
            "meetings": meetings,
            "people": people,
            "processes": processes,
            "gathered_s": round(gathered_s, 1),
            **_watched(host, crowd, seconds),
        }
    print(row, flush=True)
    return row


def holds(row: dict[str, Any]) -> bool:
    """Whether a number of meetings holds, by what was measured of it."""
    p95_ms = row["relay_p95_ms"]
    return (
        p95_ms is not None
        and p95_ms < HOLDS_MS
        and row["lost_share"] <= HOLDS_LOST
        and row["rate_slowest"] >= HOLDS_RATE
    )


def largest(host: Host, people: int, effort: LoadEffort) -> tuple[int, list[dict[str, Any]]]:
    """The largest number of meetings that holds, and all that was tried: doubled until one does
    not hold, then halved in between."""
    rows: list[dict[str, Any]] = []

    def held(meetings: int) -> bool:
        row = measured(host, meetings, people, effort.seconds, effort.processes)
        rows.append({**row, "holds": holds(row)})
        return holds(row)

    least, most = 0, 1
    while held(most):
        least, most = most, min(2 * most, effort.most_meetings)
        if least == most:
            return least, rows
    while most - least > 1:
        middle = (least + most) // 2
        least, most = (middle, most) if held(middle) else (least, middle)
    return least, rows


def overload(host: Host, meetings: int, people: int, effort: LoadEffort) -> dict[str, Any]:
    """What those inside see of others who find no place, on a server with as many places as
    `meetings` of `people` take."""
    with gathered(host.plan(meetings, people), effort.processes) as inside:
        time.sleep(SETTLING_S)
        before = _watched(host, inside, effort.seconds)
        with gathered(host.plan(_LATE_MEETINGS, people), 1, wait=False) as outside:
            answers = _first_answers(outside, _LATE_MEETINGS * people)
            after = _watched(host, inside, effort.seconds)
            answers += outside.collect().answers
    row = {
        "meetings": meetings,
        "people": people,
        "too_many": _LATE_MEETINGS * people,
        "answers": dict(answers),
        **{
            f"{name}_{when}": figures[name]
            for name in ("relay_p95_ms", "rate_slowest")
            for when, figures in (("before", before), ("during", after))
        },
    }
    print(row, flush=True)
    return row


def _first_answers(crowd: Crowd, people: int) -> Counter[str]:
    """What so many were told who came just now, once all have been told something."""
    answers: Counter[str] = Counter()
    while answers.total() < people:
        answers += crowd.collect().answers
        time.sleep(0.1)
    return answers


def memory(host: Host, meetings: int, people: int, effort: LoadEffort) -> dict[str, Any]:
    """How the server's memory grows while `meetings` go on, MiB a minute."""
    times_s, resident_mib = [], []
    with gathered(host.plan(meetings, people), effort.processes) as crowd:
        time.sleep(SETTLING_S)
        began = time.monotonic()
        while time.monotonic() - began < effort.memory_s:
            usage = host.usage()
            if usage is not None:
                times_s.append(time.monotonic() - began)
                resident_mib.append(usage.resident_bytes / 2**20)
            crowd.collect()  # what people count must not grow either
            time.sleep(_SAMPLE_S)
    row = {
        "meetings": meetings,
        "people": people,
        "seconds": effort.memory_s,
        "first_mib": round(resident_mib[0]),
        "last_mib": round(resident_mib[-1]),
        "slope_mib_a_minute": round(60.0 * float(np.polyfit(times_s, resident_mib, 1)[0]), 2),
    }
    print(row, flush=True)
    return row


def run(writer: FigureWriter, effort: LoadEffort) -> None:
    """Measure the goal, the largest number, memory and overload, and report."""
    cache, about = writer.cache(), {**vars(effort), "people": GOAL_PEOPLE}

    def tried(host: Host) -> dict[str, Any]:
        found, rows = largest(host, GOAL_PEOPLE, effort)
        return {"meetings": found, "rows": rows}

    with own_host(effort.most_meetings * GOAL_PEOPLE) as host:
        goal = cache.measured(
            "goal",
            about,
            lambda: measured(host, GOAL_MEETINGS, GOAL_PEOPLE, effort.seconds, effort.processes),
        )
        found = cache.measured("largest", about, lambda: tried(host))
        assert goal is not None
        assert found is not None
        held = max(found["meetings"], 1)
        grown = cache.measured("memory", about, lambda: memory(host, held, GOAL_PEOPLE, effort))
    with own_host(held * GOAL_PEOPLE) as host:
        full = cache.measured("overload", about, lambda: overload(host, held, GOAL_PEOPLE, effort))
    places = effort.most_meetings * GOAL_PEOPLE
    with several_gateways(effort.gateways, places) as host:
        spread = cache.measured(
            "several",
            about,
            lambda: {
                "goal": measured(
                    host, GOAL_MEETINGS, GOAL_PEOPLE, effort.seconds, effort.processes
                ),
                **tried(host),
            },
        )
    writer.write(
        {
            **about,
            "goal": goal,
            "largest": found,
            "memory": grown,
            "overload": full,
            "several": spread,
        }
    )


def _watched(host: Host, crowd: Crowd, seconds: float) -> dict[str, Any]:
    crowd.collect()
    before, began = host.usage(), time.monotonic()
    time.sleep(seconds)
    tally, after = crowd.collect(), host.usage()
    watched_s = time.monotonic() - began
    return {
        **tally.figures(watched_s),
        **_used(before, after, watched_s),
        "load": round(os.getloadavg()[0], 1),
    }


def _used(before: Usage | None, after: Usage | None, seconds: float) -> dict[str, Any]:
    if before is None or after is None:
        return {"server_cores": None, "server_resident_mib": None}
    return {
        "server_cores": round((after.processor_s - before.processor_s) / seconds, 3),
        "server_resident_mib": round(after.resident_bytes / 2**20),
    }
