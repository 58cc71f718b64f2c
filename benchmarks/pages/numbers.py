"""The README's numbers: a row each, of many benchmarks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from benchmarks.pages.provenance import CHANGED, Figures, short_origin
from benchmarks.reporting.markdown import markdown_table

SOURCES = (
    "serve",
    "meeting",
    "enrolment",
    "train",
    "expressions",
    "relight",
    "local-view",
    "gpu",
    "frontier",
)
"""Files of figures, in the order in which `numbers` takes them."""


def numbers(*sources: Figures) -> str:
    """Every row with the command and the commit that it was measured with, under `SOURCES`."""
    rows = [
        [what, figure, f"`metanerf bench {source['benchmark']}`", short_origin(source)]
        for source, made in zip(sources, _ROWS, strict=True)
        for what, figure in made(source)
    ]
    legend = [f"{CHANGED}: the tree had uncommitted changes."]
    if any("date_from" in source for source in sources):
        legend.append("Dates are those of the commits where a file says so (`date_from`).")
    return "\n\n".join([markdown_table(_HEAD, rows), " ".join(legend)])


_HEAD = ("what", "figure", "command", "measured at")
_Rows = Iterable[tuple[str, str]]


def _serve(figures: Figures) -> _Rows:
    def drawn(performers: int, size: int) -> str:
        row = _only(figures["drawn"], splats=10_000, performers=performers, size=size)
        return _milliseconds(row)

    yield "pose and camera to picture, 10,000 splats, 512 x 512", drawn(1, 512)
    yield "the same, 1024 x 1024", drawn(1, 1024)
    yield "four performers of 10,000 splats, 1024 x 1024", drawn(4, 1024)
    session = figures["session"]
    late = f"{1e3 * session['over_twice_p50']:.0f} in 1,000"
    yield f"frames over twice the median, of {session['frames']:,} in one session", late
    alone = _only(figures["served"], viewers=1, size=1024)
    yield (
        "frames a second that a browser shows of a meeting, 1024 x 1024, the whole on 2 cores",
        f"{alone['frames_per_second']:.0f}",
    )
    three = _only(figures["served"], viewers=3, size=512)
    yield "three viewers, 512 x 512 each", f"{three['frames_per_second_slowest']:.0f} each"
    step = "a step of training, 256 x 256, 10,000 splats"
    yield step, _milliseconds(figures["trained"])


def _meeting(figures: Figures) -> _Rows:
    def shown(performers: int, viewers: int = 1) -> str:
        row = _only(figures["rows"], drawn_by="server", performers=performers, viewers=viewers)
        return f"{row['frames_per_second_slowest']:.0f}"

    yield (
        "frames a second, 512 x 512: one, two or four performers; four for two viewers; eight",
        f"{', '.join(map(shown, (1, 2, 4)))}; {shown(4, 2)} each; {shown(8)}",
    )
    by = {
        way: _only(figures["rows"], drawn_by=way, performers=1, viewers=1)
        for way in ("server", "page")
    }
    yield (
        "landmarks to picture, one performer: by the server, by the page",
        ", ".join(f"{row['latency_p50_ms']} ms" for row in by.values()),
    )
    finder = figures["landmark_finder"]
    yield (
        "finding landmarks in a webcam's picture, by a page beside a meeting; looking at a face "
        "or a hand beside that",
        f"{finder['p50_ms']:.0f} ms; {finder['face_and_hands']['p50_ms']:.0f} ms",
    )
    sent = f"{by['server']['up_a_performer_mbit_s']:.2f} Mbit/s"
    yield "what somebody who is seen sends", sent


def _enrolment(figures: Figures) -> _Rows:
    for row in figures["rows"]:
        yield (
            f"from a clip of {row['seconds']:.0f} s that is sent to a first likeness that can be "
            "met; to the finished model",
            f"{row['first_likeness_s']:.0f} s; {row['model_s']:.0f} s",
        )
        seen = [row["viewer"][doing] for doing in ("alone", "capture", "train")]
        yield (
            "what a viewer's browser on the same cores shows of a meeting, by the server: before "
            "that; while the clip is captured; while the model is trained",
            "; ".join(f"{one['frames_per_second']:.0f} a second" for one in seen),
        )


def _train(figures: Figures) -> _Rows:
    cold = dict(figures["curves"]["cold"])
    yield (
        "a person's model from nothing, in new views (3 performers, exact poses): after 1, 3, "
        "15 s of one thread",
        f"{', '.join(f'{cold[budget_s]:.1f}' for budget_s in (1.0, 3.0, 15.0))} dB",
    )


def _expressions(figures: Figures) -> _Rows:
    face, hands = (figures["worth"][f"{part}: both"]["gain_db"] for part in ("face", "hands"))
    yield (
        "a face and hands that move, against ones that don't, on their crops in unseen "
        f"expressions ({len(figures['performers'])} performers)",
        f"{face:.1f} and {hands:.1f} dB",
    )


def _relight(figures: Figures) -> _Rows:
    relit = [row["psnr_relit"] for row in figures["rows"]]
    yield (
        "shown in another room's light, against the truth, where albedos were learnt "
        f"({len(relit)} pairs)",
        f"{min(relit):.0f} to {max(relit):.0f} dB",
    )


def _local_view(figures: Figures) -> _Rows:
    row = _only(figures["drawn"], splats=5000, size=512)
    yield (
        "drawn by the page, 5,000 splats, 512 x 512, no graphics card",
        f"{row['pictures_per_second']:.0f} a second",
    )


def _gpu(figures: Figures) -> _Rows:
    row = _only(figures["splats"], splats=10_000, performers=1, size=1024)
    yield (
        f"on a data-centre GPU ({figures['device']}): 10,000 splats, 1024 x 1024, on the device; "
        "copied to the host's memory",
        f"{row['device_p50_ms']:.2f} ms; {row['host_p50_ms']:.2f} ms",
    )
    field = _only(figures["fields"], size=1024)
    yield (
        "the paper's field there, 1024 x 1024, all exact speed-ups (the paper: 1.2 on an RTX "
        "3080 Ti)",
        f"{field['frames_a_second']:.0f} frames a second",
    )


def _frontier(figures: Figures) -> _Rows:
    megabytes = {row["preset"]: row["file_megabytes"] for row in figures["accuracy"]}
    files = (f"{megabytes[preset]:.2g} MB (`{preset}`)" for preset in ("splats", "fast"))
    yield "a model's file", ", ".join(files)


_ROWS = (
    _serve,
    _meeting,
    _enrolment,
    _train,
    _expressions,
    _relight,
    _local_view,
    _gpu,
    _frontier,
)
"""What makes the rows of each of `SOURCES`."""


def _only(rows: list[dict[str, Any]], **wanted: Any) -> dict[str, Any]:
    """The one row that has these values."""
    (row,) = (row for row in rows if all(row[key] == value for key, value in wanted.items()))
    return row


def _milliseconds(row: dict[str, Any]) -> str:
    return f"{row['p50_ms']:.1f} ms (p95 {row['p95_ms']:.1f})"
