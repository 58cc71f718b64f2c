"""One measurement of an axis of training: spoil, train, judge; nothing it raises goes further."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.stability.judge import figures, guarded
from benchmarks.stability.material import Material
from benchmarks.stability.precision import PRECISIONS, stored_in
from benchmarks.stability.sheet import write_strip
from renderer.evaluation.lpips import Lpips
from renderer.training import train
from scene.sequence import PoseTrust

SPLATS = "splats"


@dataclass(frozen=True)
class Method:
    """How a model is trained, and judged."""

    name: str
    """In tables."""
    preset: str
    iterations: int
    believes_poses: bool
    """Poses count as exact, whether they are or not."""
    aligned: bool
    """Each test pose is aligned with its own picture first: without it, no model of poses that are
    off can be judged, since its canonical body takes the mean of their errors."""

    @property
    def trust(self) -> str:
        """What becomes of poses, in a measurement's name."""
        return "believed" if self.believes_poses else "refined"


@dataclass(frozen=True)
class SplatEffort:
    """How long splats are trained."""

    iterations: int = 300
    """Where poses are exact."""
    refining_iterations: int = 600
    """Where poses are off: refining them begins after six looks at each frame."""

    @property
    def exact(self) -> Method:
        """For axes whose poses are exact."""
        return Method(SPLATS, SPLATS, self.iterations, believes_poses=True, aligned=False)

    @property
    def refining(self) -> Method:
        """For poses that are off, as those of any capture."""
        return Method(SPLATS, SPLATS, self.refining_iterations, believes_poses=False, aligned=True)


def measure_training(
    method: Method,
    make: Callable[[], Material],
    lpips: Lpips,
    clock: Callable[[], float],
    strip: Path,
) -> dict[str, Any]:
    """The outcome and figures; what the worst view looks like is written to `strip`."""

    def trained_and_judged() -> dict[str, Any]:
        material = make()
        trust = PoseTrust.EXACT if method.believes_poses else PoseTrust.ESTIMATED
        model = train(
            material.sequence(trust),
            preset=method.preset,
            iterations=method.iterations,
            seed=material.seed,
            clock=clock,
        )
        if material.precision != PRECISIONS[0]:
            model = stored_in(model, material.precision)
        found, worst = figures(model, material, lpips, aligned=method.aligned)
        write_strip(strip, material.train[len(material.train) // 2], worst)
        return found

    return guarded(trained_and_judged)
