"""`metanerf bench install`: everything of this package in one file of figures."""

from __future__ import annotations

from typing import Any

from benchmarks.install.code import commands, lines_by_package, operations_count, settings_count
from benchmarks.install.fresh import fresh_install
from benchmarks.install.packages import dependencies, files_of, megabytes, pulled_in, weights
from benchmarks.install.start_up import first_answer, help_ms, import_ms
from benchmarks.reporting.figures import FigureWriter


def run(writer: FigureWriter, *, fresh: bool) -> None:
    """Measure and report; `fresh`: with an installation from nothing, which asks registries."""
    direct = dependencies()
    rows = weights(direct)
    for row in rows:
        if row["module"]:
            row["import"] = import_ms(row["module"])
    installed = pulled_in(one.requirement for one in direct)
    figures: dict[str, Any] = {
        "dependencies": rows,
        "packages": len(installed),
        "packages_mb": megabytes(files_of(installed)),
        "help": help_ms(),
        "server": first_answer(),
        "lines": lines_by_package(),
        "settings": settings_count(),
        "operations": operations_count(),
        **commands(),
    }
    if fresh:
        figures["fresh"] = fresh_install()
    writer.write(figures)
