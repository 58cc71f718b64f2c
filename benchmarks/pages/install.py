"""The tables of docs/parsimony.md about the code."""

from __future__ import annotations

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table


def install(figures: Figures) -> str:
    """Packages, start-up and size."""
    return "\n\n".join(
        [
            "### Packages",
            _dependencies(figures),
            f"Together {figures['packages']} packages of {figures['packages_mb']:,.0f} MB, with "
            "those that several bring.",
            "### What a user waits for, and what there is",
            _whole(figures),
            measured_at(figures),
        ]
    )


def _dependencies(figures: Figures) -> str:
    rows = sorted(figures["dependencies"], key=lambda row: -row["goes_with_it_mb"])
    head = ["package", "for", "MB", "with what only it brings", "import, ms", "instead"]
    return markdown_table(
        head,
        (
            [
                f"{row['name']} {row['version']}",
                row["use"],
                f"{row['own_mb']:,.1f}",
                f"{row['goes_with_it_mb']:,.1f}",
                f"{row['import']['processor_ms']:,.0f}" if row["import"] else "-",
                row["instead"],
            ]
            for row in rows
        ),
    )


def _whole(figures: Figures) -> str:
    helped, server, lines = figures["help"], figures["server"], figures["lines"]
    rows = [
        *(_fresh(figures["fresh"]) if "fresh" in figures else ()),
        [
            "`metanerf --help`",
            f"{helped['wall_ms']:.0f} ms ({helped['processor_ms']:.0f} ms of processor time)",
        ],
        [
            "`metanerf demo` to its first answer: new folder, known folder",
            f"{server['new_folder_s']:.1f} s, {server['known_folder_s']:.1f} s; "
            f"{server['resident_mb']:.0f} MB then",
        ],
        [
            "lines of code that are not blank",
            ", ".join(f"{name} {count:,}" for name, count in lines.items()),
        ],
        [
            "settings; operations of the API; commands and their options",
            f"{figures['settings']}; {figures['operations']}; {figures['commands']} and "
            f"{figures['options']}",
        ],
    ]
    return markdown_table(["what", "figure"], rows)


def _fresh(fresh: Figures) -> list[list[str]]:
    return [
        [
            "`make demo` on a new machine: packages but torch",
            f"{fresh['packages_s']:.0f} s, {fresh['packages_mb']:,.0f} MB",
        ],
        [
            "the page: npm's packages, the build",
            f"{fresh['page_s']:.0f} s, {fresh['page_tools_mb']:,.0f} MB; "
            f"{fresh['page_mb']:.1f} MB of page",
        ],
        [
            "the renderer's compiled kernels",
            f"{fresh['kernels_s']:.0f} s, {fresh['kernels_mb']:.1f} MB",
        ],
    ]
