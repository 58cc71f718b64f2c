"""What people of a load test count, and what of several processes comes to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from scene.arrays import Array, Float


@dataclass
class Tally:
    """Counts of some people over some time."""

    relay_s: list[float] = field(default_factory=list)
    """From each motion's sending to its first coming to each viewer, s."""
    sent: int = 0
    """Motions, by those who moved."""
    received: int = 0
    """Poses, by all viewers."""
    expected: int = 0
    """Poses that the same ticks would have brought had none been lost."""
    bytes_received: int = 0
    viewer_rates: list[float] = field(default_factory=list)
    """Of each viewer: motions of one performer that were new to them, a second."""
    longest_gaps_s: list[float] = field(default_factory=list)
    """Of each viewer: the longest time in which nobody moved."""
    answers: Counter[str] = field(default_factory=Counter)
    """To those who asked to come in: HTTP status, with ` Retry-After` where it says when."""
    processor_s: float = 0.0
    """Of the people's own process."""

    @classmethod
    def sum(cls, parts: Iterable[Tally]) -> Tally:
        """Of several processes together."""
        whole = cls()
        for part in parts:
            for name, value in vars(part).items():
                setattr(whole, name, getattr(whole, name) + value)
        return whole

    def figures(self, seconds: float) -> dict[str, Any]:
        """What counts, over so many seconds; relay times in ms, None where nothing came."""
        motions = len(self.relay_s)
        viewers = max(len(self.viewer_rates), 1)
        relay_ms: Float[Array, "N"] = 1e3 * np.array(self.relay_s)
        return {
            "motions_sent_per_second": round(self.sent / seconds, 1),
            "poses_per_second": round(self.received / seconds, 1),
            "down_mbit_s": round(8e-6 * self.bytes_received / seconds, 3),
            **{
                f"relay_p{q}_ms": round(float(np.percentile(relay_ms, q)), 1) if motions else None
                for q in (50, 95, 99)
            },
            "lost_share": round(1.0 - self.received / max(self.expected, 1), 4),
            "rate_mean": round(sum(self.viewer_rates) / viewers, 2),
            "rate_slowest": round(min(self.viewer_rates, default=0.0), 2),
            "longest_gap_s": round(max(self.longest_gaps_s, default=0.0), 2),
            "answers": dict(self.answers),
            "generator_cores": round(self.processor_s / seconds, 3),
        }
