"""Trains splats of which no more are kept than the clip shows a need for.

Late in the training, once there is little left to learn, splats that look alike are merged: to as
few as frames that were held out until then show no difference, by bisection over their number, each
tried after some steps of training. None may be worse than all splats, nor the face or the hands by
themselves. The rest of the training goes on from those few, on all frames, and is shorter for it.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from renderer.splats.levels.light import light_all_round
from renderer.splats.model import SplatModel
from renderer.splats.settings import Size
from renderer.splats.training.evidence import frames_looked_at
from renderer.splats.training.held_out import Errors, WatchedFrames, held_out_frames
from renderer.splats.training.merging import Grouping, groupings
from renderer.splats.training.surface_kinds import KINDS
from renderer.splats.training.trainer import SplatTrainer
from scene.arrays import Array, Float

_SIZED_FROM = 0.7
"""Share of the training after which the number is chosen."""
_LEARNS_FROM = 0.4
"""Share of the training whose rates merged splats begin with: they have to move again."""
_LADDER = 2.0**-0.5
"""Each number that may be tried is so many times the one before."""
_LEAST = 500
"""Splats at least."""
_REFIT_SHARE, _REFIT_STEPS = 0.1, (20, 200)
"""Steps of training before a number is judged, as a share of those before, and their limits."""
_WIDEST_M = 0.02
"""Most deviation of a merged splat: wider ones show as a halo beside the body."""
_VIEWS = 24
"""Views all round in which a splat's light is looked at."""
_LEAST_LIGHT_PX = 1e-3
_LOOKED_AT, _LOOKED_AT_MORE = [KINDS.index("face"), KINDS.index("hands")], 3.0
"""Whose light counts how much more."""


class SizedTrainer:
    """A `SplatTrainer` whose splats are merged on the way (a `Trainer`)."""

    def __init__(self, trainer: SplatTrainer, size: Size) -> None:
        self._trainer, self._size = trainer, size
        self._steps, self._report = 0, dict[str, Any]()
        # neither may exceed the number asked for, nor wait for those merged
        trainer.adds_sides = False
        if size == "auto":
            trainer.held_out = held_out_frames(trainer.frames)

    def warm_up(self) -> None:
        """As of the trainer."""
        self._trainer.warm_up()

    def before_step(self, fraction: float) -> None:
        """Choose the number, late in the training."""
        self._trainer.before_step(fraction)
        if not self._report and fraction >= _SIZED_FROM:
            self._report = self._choose(fraction)
            self._trainer.held_out = ()

    def step(self, fraction: float) -> float:
        """As of the trainer."""
        self._steps += 1
        return self._trainer.step(fraction if not self._report else _again(fraction))

    def preview(self) -> Float[Array, "H W 3"]:
        """As of the trainer."""
        return self._trainer.preview()

    def state(self) -> dict[str, Array]:
        """The trainer's, and whether the number is chosen."""
        sizing = json.dumps({"steps": self._steps, "report": self._report})
        return {**self._trainer.state(), "sizing": np.array(sizing)}

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`."""
        self._trainer.restore(state)
        sizing = json.loads(str(state["sizing"]))
        self._steps, self._report = sizing["steps"], sizing["report"]
        if self._size == "auto":
            chosen = bool(self._report)
            self._trainer.held_out = () if chosen else held_out_frames(self._trainer.frames)

    def halve_learning_rate(self) -> None:
        """As of the trainer."""
        self._trainer.halve_learning_rate()

    def finish(self, metrics: dict[str, Any]) -> SplatModel:
        """The model; its metrics tell under `size` what was tried, and what it cost."""
        return self._trainer.finish({**metrics, "size": self._report})

    def _choose(self, fraction: float) -> dict[str, Any]:
        """Merge; returns the report."""
        trainer = self._trainer
        frames = trainer.held_out or tuple(frames_looked_at(trainer.frames))
        watched, count = WatchedFrames(trainer, frames), len(trainer.splats)
        if isinstance(self._size, int):
            for grouping in self._groupings(watched, [self._size] * (count > self._size)):
                trainer.merge(grouping)
            return {"asked": self._size, "of": count, "kept": len(trainer.splats)}
        rungs = int(np.log(count / _LEAST) / -np.log(_LADDER))
        counts = [round(count * _LADDER**rung) for rung in range(1, rungs + 1)]
        tried, steps = self._bisect([None, *self._groupings(watched, counts)], watched, fraction)
        return {
            "asked": "auto",
            "of": count,
            "kept": len(trainer.splats),
            "frames": len(frames),
            "tried": tried,
            "steps": steps,
        }

    def _bisect(
        self, ladder: list[Grouping | None], watched: WatchedFrames, fraction: float
    ) -> tuple[list[dict[str, Any]], int]:
        """Go on with the last of `ladder` that is no worse than the first, all splats; what was
        tried, and in how many steps."""
        trainer, before = self._trainer, self._trainer.state()
        steps = int(np.clip(_REFIT_SHARE * self._steps, *_REFIT_STEPS))

        def errors(grouping: Grouping | None) -> Errors:
            trainer.restore(before)
            if grouping is not None:
                trainer.merge(grouping)
            for _ in range(steps):
                trainer.learn(_again(fraction))
            return watched.errors()

        of_all = errors(None)
        best, good, bad, tried = trainer.state(), 0, len(ladder), list[dict[str, Any]]()
        while bad - good > 1:
            rung = (good + bad) // 2
            found = errors(ladder[rung])
            good_enough = found.as_good_as(of_all)
            tried.append({"splats": len(trainer.splats), **found.lost(of_all), "good": good_enough})
            if good_enough:
                best, good = trainer.state(), rung
            else:
                bad = rung
        trainer.restore(best)
        return tried, steps * (len(tried) + 1)

    def _groupings(self, watched: WatchedFrames, counts: list[int]) -> list[Grouping]:
        trainer = self._trainer
        splats, model = trainer.splats, trainer.model_so_far()
        light = light_all_round(model, _VIEWS) / _VIEWS + watched.light() + _LEAST_LIGHT_PX
        light[np.isin(splats.kinds, _LOOKED_AT)] *= _LOOKED_AT_MORE
        widest_m = _WIDEST_M if self._size == "auto" else np.inf
        found = groupings(
            model.parameters, splats.first.normals, splats.kinds, light, counts, widest_m
        )
        return list(found)


def _again(fraction: float) -> float:
    """Where rates stand at `fraction` of the training, once splats are merged."""
    return _LEARNS_FROM + (fraction - _SIZED_FROM) * (1.0 - _LEARNS_FROM) / (1.0 - _SIZED_FROM)
