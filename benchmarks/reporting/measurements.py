"""Measurements that outlive a cut: one small file each, written whole or not at all.

A run that is started again measures only what is missing, or what was measured of something else.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.reporting.checkout import Checkout
from benchmarks.reporting.origin import origin_of


@dataclass(frozen=True)
class MeasurementCache:
    """Figures in `folder`, each with what it was measured of and where."""

    folder: Path
    only: str = ""
    """Measurements whose name does not hold this are left as they are, even if missing."""
    checkout: Checkout = Checkout()  # noqa: RUF009 (frozen)

    def measured(
        self, name: str, of: dict[str, Any], measure: Callable[[], dict[str, Any]]
    ) -> dict[str, Any] | None:
        """The figures `name`, stored or measured now. None where `only` leaves them out.

        Args:
            of: what the figures are true of; stored figures of anything else are measured anew.
        """
        path = self.folder / f"{name.replace('/', '-')}.json"
        if path.exists():
            stored = json.loads(path.read_text())
            if stored["of"] == json.loads(json.dumps(of)):
                return stored["figures"]
        if self.only not in name:
            return None
        origin = origin_of(self.checkout)
        figures = {**measure(), **origin}
        self.folder.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_text(json.dumps({"name": name, "of": of, "figures": figures}, indent=1) + "\n")
        part.replace(path)
        print(name, json.dumps(figures), flush=True)
        return figures
