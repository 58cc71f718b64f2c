"""Tables of docs/load.md."""

from __future__ import annotations

import math

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_OVERHEAD_BYTES = 97
"""Of a message on its way: IPv4 20, UDP 8, DTLS 1.2 with AES-GCM 37, SCTP 12, DATA chunk 16, and
about 4 of acknowledgements that share its packet."""
_TICKS = 30
_VOICES, _VOICE_MBIT_S = 1.5, 0.05
"""Of each person: others who are heard at once, on average, and Opus with its packets' heads."""
_CORE_EUROS, _TERABYTE_EUROS = 8.0, 1.0
"""A month: a core of a rented server, and a terabyte sent, as European hosts ask without
contracts."""
_HOURS = 730.0
_SPARE = 0.7
"""Of a core's time that is planned with: who fills it all has no room for a peak."""
_CROWDS = (1_000, 100_000)
_LIVEKIT = "https://docs.livekit.io/transport/self-hosting/benchmark"
_LIVEKIT_PACKETS = 48_000


_HEAD = [
    "meetings of 4",
    "poses a second",
    "sent to received, ms: p50, p95, p99",
    "lost",
    "slowest viewer, motions a second",
    "gateways, cores",
    "people, cores",
    "load",
]


def load(figures: Figures) -> str:
    """What was measured of one gateway, and beside what it is to be seen."""
    goal, found = figures["goal"], figures["largest"]
    rows = [("goal", goal), *(("", row) for row in sorted(found["rows"], key=_meetings))]
    table = markdown_table(_HEAD, [_row(*row) for row in rows])
    best = _best(figures)
    memory, full = figures["memory"], figures["overload"]
    return "\n\n".join(
        [
            f"Largest number that holds: **{found['meetings']}** meetings of {figures['people']}.",
            table,
            f"Coming in: {best['meetings'] * best['people']} people were there, and saw others "
            f"move, after {best['gathered_s']:g} s.",
            f"Memory: {memory['first_mib']} MiB, and after {memory['seconds']:g} s of "
            f"{memory['meetings']} meetings {memory['last_mib']} MiB, a slope of "
            f"{memory['slope_mib_a_minute']:g} MiB a minute.",
            f"Overload: to {full['too_many']} people too many a full gateway answered "
            f"{_answers(full['answers'])}; meanwhile the slowest of those inside saw "
            f"{full['rate_slowest_during']:.1f} motions a second of each person "
            f"({full['rate_slowest_before']:.1f} before), p95 {full['relay_p95_ms_during']:.0f} ms "
            f"({full['relay_p95_ms_before']:.0f} before).",
            f"A core of the gateway sent {_poses_a_core(best):,.0f} poses a second, in "
            f"{_poses_a_core(best) / best['people']:,.0f} messages; LiveKit's server, in Go, "
            f"[publishes]({_LIVEKIT}) about {_LIVEKIT_PACKETS:,} packets a second a core, which "
            "it forwards as they are, where ours works out each performer's pose of the moment.",
            _several(figures),
            measured_at(figures),
        ]
    )


def _several(figures: Figures) -> str:
    """What more gateways on the same cores hold together."""
    several = figures["several"]
    rows = [
        ("goal", several["goal"]),
        *(("", row) for row in sorted(several["rows"], key=_meetings)),
    ]
    return "\n\n".join(
        [
            f"**{figures['gateways']} gateways** on the same two cores, over PostgreSQL and Redis: "
            f"the largest number that holds is **{several['meetings']}**.",
            markdown_table(_HEAD, [_row(*row) for row in rows]),
        ]
    )


def estimate(figures: Figures) -> str:
    """Paper: what crowds would cost, from what one gateway holds."""
    best = _best(figures)
    people = best["meetings"] * best["people"]
    people_a_core = _SPARE * people / best["server_cores"]
    mbit_s = _down_mbit_s(best)
    rows = []
    for crowd in _CROWDS:
        cores, gbit_s = math.ceil(crowd / people_a_core), 1e-3 * crowd * mbit_s
        terabytes = gbit_s / 8e3 * 3600.0 * _HOURS
        euros = cores * _CORE_EUROS + terabytes * _TERABYTE_EUROS
        meetings = crowd / best["people"]
        rows.append(
            [
                f"{crowd:,}",
                f"{cores:,}",
                f"{gbit_s:.2g}",
                f"{terabytes:,.0f}",
                f"{_rounded(euros):,}",
                f"{meetings:,.0f}",
            ]
        )
    head = [
        "people at once",
        "cores",
        "Gbit/s down",
        "TB a month",
        "euros a month",
        "transactions a second",
    ]
    return "\n\n".join(
        [
            markdown_table(head, rows),
            f"From {people} people on {best['server_cores']:.2f} cores, {_SPARE:.0%} of each core "
            f"planned with; {mbit_s:.2f} Mbit/s down a person: poses with {_OVERHEAD_BYTES} bytes "
            f"around each message, and {_VOICES:g} voices of {_VOICE_MBIT_S:g} Mbit/s, which were "
            f"not measured here. {_CORE_EUROS:g} euros a core and month, {_TERABYTE_EUROS:g} a "
            f"terabyte, everybody there day and night ({_HOURS:g} h). Transactions: one a second "
            "and meeting, by which gateways note who is there.",
        ]
    )


def _row(name: str, row: Figures) -> list[str]:
    times = [row[f"relay_p{q}_ms"] for q in (50, 95, 99)]
    return [
        f"{row['meetings']}{f' ({name})' if name else ''}",
        f"{row['poses_per_second']:,.0f}",
        ", ".join("-" if one is None else f"{one:.0f}" for one in times),
        f"{row['lost_share']:.2%}",
        f"{row['rate_slowest']:.1f}",
        f"{row['server_cores']:.2f}",
        f"{row['generator_cores']:.2f}",
        f"{row['load']:g}",
    ]


def _best(figures: Figures) -> Figures:
    """The row of the largest number that holds, or of the least that was tried."""
    held = [row for row in figures["largest"]["rows"] if row["holds"]]
    return max(held, key=_meetings) if held else min(figures["largest"]["rows"], key=_meetings)


def _meetings(row: Figures) -> int:
    return row["meetings"]


def _poses_a_core(row: Figures) -> float:
    return row["poses_per_second"] / row["server_cores"]


def _down_mbit_s(row: Figures) -> float:
    """Of each person."""
    poses = row["down_mbit_s"] / (row["meetings"] * row["people"])
    return poses + 8e-6 * _TICKS * _OVERHEAD_BYTES + _VOICES * _VOICE_MBIT_S


def _answers(answers: dict[str, int]) -> str:
    told = {"503 Retry-After": "503 with `Retry-After`"}
    return " and ".join(f"{told.get(one, one)} ({n} times)" for one, n in sorted(answers.items()))


def _rounded(euros: float) -> int:
    digits = 10 ** max(0, len(str(int(euros))) - 2)
    return round(euros / digits) * digits
