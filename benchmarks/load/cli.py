"""`metanerf loadtest`: how many meetings a server holds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import typer

from scene.errors import InvalidInput
from services.cli.terminal import print_table

app = typer.Typer(help="How many meetings a server holds, and how late motion comes.")


@app.callback(invoke_without_command=True)
def loadtest(
    meetings: Annotated[int, typer.Option(help="Meetings at once.", min=1)] = 1,
    people: Annotated[int, typer.Option(help="In each of them.", min=1, max=12)] = 4,
    seconds: Annotated[float, typer.Option(help="Time of measuring.", min=1.0)] = 30.0,
    server: Annotated[
        str | None,
        typer.Option(help="Address of a server that runs; none: one of its own, on this machine."),
    ] = None,
    token: Annotated[str | None, typer.Option(help="Of an account there; none: a guest's.")] = None,
    model: Annotated[
        str | None, typer.Option(help="Id of a model that may move; none: the account's first.")
    ] = None,
    processes: Annotated[
        int, typer.Option(help="That people are spread over; each fills a core at most.", min=1)
    ] = 1,
    gateways: Annotated[
        int, typer.Option(help="Of a server of its own; from 2 on over PostgreSQL.", min=1)
    ] = 1,
    largest: Annotated[
        bool, typer.Option("--largest", help="Find how many meetings hold, from 1 to --meetings.")
    ] = False,
) -> None:
    """Synthetic people meet: poses go up and come down, as from and to pages that draw.

    Told are packets a second, how long each motion took from its sender to its viewers, what was
    lost, and what the server and, apart from it, these people cost.
    """
    from benchmarks.load.gateways import at_hand
    from benchmarks.load.measure import LoadEffort, measured
    from benchmarks.load.measure import largest as find_largest

    if server is None and (token or model):
        raise InvalidInput(
            "--token and --model must come with --server; got them without; a server of its own "
            "has a model and lets guests in"
        )
    if server is not None and gateways > 1:
        raise InvalidInput("--gateways must be of a server of its own; got it with --server")
    effort = LoadEffort(seconds, most_meetings=meetings, processes=processes)
    with at_hand(server, token, model, most_people=meetings * people, gateways=gateways) as host:
        if largest:
            found, rows = find_largest(host, people, effort)
        else:
            found, rows = None, [measured(host, meetings, people, seconds, processes)]
    print_table(line for row in rows for line in _lines(row))
    if found is not None:
        typer.echo(f"{found} meetings of {people} hold")


def _lines(row: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Of one number of meetings: what, how much, and whether that is good enough."""
    from benchmarks.load.measure import HOLDS_LOST, HOLDS_MS, HOLDS_RATE

    late, lost, rate = row["relay_p95_ms"], row["lost_share"], row["rate_slowest"]
    good = late is not None and late < HOLDS_MS
    yield "meetings", f"{row['meetings']} of {row['people']}", "good"
    yield "motions sent", f"{row['motions_sent_per_second']:,.0f} a second", "good"
    yield (
        "poses received",
        f"{row['poses_per_second']:,.0f} a second, {row['down_mbit_s']:.1f} Mbit/s",
        "good",
    )
    times = [row[f"relay_p{q}_ms"] for q in (50, 95, 99)]
    told = ", ".join("-" if one is None else f"{one:.0f}" for one in times)
    yield "sent to received", f"{told} ms (p50, p95, p99)", _verdict(good, f"{HOLDS_MS:g} ms")
    yield "lost", f"{lost:.2%}", _verdict(lost <= HOLDS_LOST, f"{HOLDS_LOST:.0%}")
    yield (
        "slowest viewer",
        f"{rate:.1f} motions a second of each person",
        _verdict(rate >= HOLDS_RATE, f"{HOLDS_RATE:g}"),
    )
    cores, mib = row["server_cores"], row["server_resident_mib"]
    cost = "tells others alone" if cores is None else f"{cores:.2f} cores, {mib} MiB"
    yield "server", cost, "good"
    yield "these people", f"{row['generator_cores']:.2f} cores", "good"


def _verdict(good: bool, limit: str) -> str:
    return "good" if good else f"beyond {limit}"
