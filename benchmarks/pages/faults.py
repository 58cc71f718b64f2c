"""The table of docs/faults.md."""

from __future__ import annotations

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table


def faults(figures: Figures) -> str:
    """What everybody saw at each fault, and what became of a training and an upload."""
    head = [
        "what failed",
        "back after, s",
        "nobody moved for, s",
        "training",
        "its model, dB",
        "upload",
        "lost",
        "recovered",
    ]
    table = markdown_table(head, [_row(row) for row in figures["rows"]])
    return "\n\n".join([table, measured_at(figures)])


def _row(row: Figures) -> list[str]:
    attempts = row["job_attempts"]
    told = f", told {row['job_told']}" if row["job_told"] else ""
    job = f"{row['job']}{told}, {attempts} attempt{'s' if attempts > 1 else ''}"
    cut = len(row["upload_interruptions"])
    upload = row["upload"] + (f", asked for again {cut} times" if cut else "")
    return [
        row["fault"],
        f"{row['mended_after_s']:g}" if row["fault"] != "nothing" else "-",
        f"{row['still_s']:.1f}",
        job,
        "-" if row["psnr"] is None else f"{row['psnr']:.1f}",
        upload,
        str(len(row["lost"])) if row["lost"] else "nothing",
        "once resumed by hand" if row["job_resumed_by_hand"] else "by itself",
    ]
