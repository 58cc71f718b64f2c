"""`metanerf bench install`: everything of this package in one file of figures."""

from __future__ import annotations

from typing import Any

from benchmarks.install.code import commands, lines_by_package, operations_count, settings_count
from benchmarks.install.fresh import fresh_install
from benchmarks.install.packages import dependencies, files_of, megabytes, pulled_in, weights
from benchmarks.install.start_up import first_answer, help_ms, import_ms
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.origin import ORIGIN


def run(writer: FigureWriter, *, fresh: bool) -> None:
    """Measure and report; `fresh`: with an installation from nothing, which asks registries."""
    cache, direct = writer.cache(), dependencies()
    modules = [one.module for one in direct if one.module]
    parts = {
        "imports": (modules, lambda: {one: import_ms(one) for one in modules}),
        "start-up": ("", lambda: {"help": help_ms(), "server": first_answer()}),
    }
    if fresh:
        parts["fresh"] = ("", fresh_install)
    found = {}
    for name, (of, measure) in parts.items():
        found[name] = cache.measured(name, {"of": of}, measure)
    installed = pulled_in(one.requirement for one in direct)
    figures: dict[str, Any] = {
        "dependencies": [
            {**row, "import": found["imports"].get(row["module"])} for row in weights(direct)
        ],
        "packages": len(installed),
        "packages_mb": megabytes(files_of(installed)),
        **_figures(found["start-up"]),
        "lines": lines_by_package(),
        "settings": settings_count(),
        "operations": operations_count(),
        **commands(),
    }
    if fresh:
        figures["fresh"] = _figures(found["fresh"])
    writer.write(figures)


def _figures(measured: dict[str, Any]) -> dict[str, Any]:
    """Without where they come from, which is the same for all."""
    return {name: value for name, value in measured.items() if name not in ORIGIN}
