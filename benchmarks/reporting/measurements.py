"""Measurements that outlive a cut: one small file each, written whole or not at all.

A run that is started again measures only what is missing, or what was measured of something else.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.reporting.figures import machine


@dataclass(frozen=True)
class MeasurementCache:
    """Figures in `folder`, each with what it was measured of and where."""

    folder: Path
    only: str = ""
    """Measurements whose name does not hold this are left as they are, even if missing."""

    def measured(
        self, name: str, of: dict[str, Any], measure: Callable[[], dict[str, Any]]
    ) -> dict[str, Any] | None:
        """The figures `name`, measured now unless they are kept. None where `only` leaves them out.

        Args:
            of: what the figures are true of; kept figures of anything else are measured anew.
        """
        path = self.folder / f"{name.replace('/', '-')}.json"
        if path.exists():
            kept = json.loads(path.read_text())
            if kept["of"] == json.loads(json.dumps(of)):
                return kept["figures"]
        if self.only not in name:
            return None
        about = machine()
        figures = {**measure(), **about}
        self.folder.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_text(json.dumps({"name": name, "of": of, "figures": figures}, indent=1) + "\n")
        part.replace(path)
        print(name, json.dumps(figures), flush=True)
        return figures
