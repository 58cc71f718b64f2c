"""The table of docs/faults.md."""

from __future__ import annotations

import re

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_STATUS = re.compile(r"\((\d{3})\)")
"""Of an answer, as `metanerf upload` words it."""


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
    statuses = {status for text in row["upload_interruptions"] for status in _STATUS.findall(text)}
    upload = row["upload"] + "".join(f", told {one}" for one in sorted(statuses))
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
