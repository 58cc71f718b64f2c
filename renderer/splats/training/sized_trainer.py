"""Trains splats of which no more are kept than the clip shows a need for.

Late in the training, once there is little left to learn, splats that look alike are merged: to as
few as leave no difference in the clip's frames, by bisection over their number, each tried after
some steps of training. None may be worse than all splats, nor the face or the hands by themselves.
The rest of the training goes on from those few, and is shorter for it. The frames are those that
training sees: more splats gain there first, and frames that were held out made the choice bolder
and no better.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from renderer.splats.levels.light import light_all_round
from renderer.splats.model import SplatModel
from renderer.splats.settings import Size
from renderer.splats.training.merging import Grouping, groupings
from renderer.splats.training.surface_kinds import KINDS
from renderer.splats.training.trainer import SplatTrainer
from renderer.splats.training.watched_frames import Errors, WatchedFrames
from scene.arrays import Array, Float

_SIZED_FROM = 0.7
"""Share of the training after which the number is chosen."""
_LEARNS_FROM = 0.55
"""Share of the training whose rates merged splats begin with: they have to move again. At those of
`_SIZED_FROM` a body loses 2 % of LPIPS, at those of 0.4 a face loses 0.2 dB."""
_LADDER = 2.0**-0.5
"""Each number that may be tried is so many times the one before."""
_LEAST = 500
"""Splats at least."""
_REFIT_SHARE, REFIT_STEPS = 0.05, (50, 200)
"""Steps of training before a number is judged, as a share of those before, and their limits."""
_WIDEST_M = 0.02
"""Most deviation of a merged splat: wider ones show as a halo beside the body."""
WATCHED, _VIEWS = 16, 24
"""Frames that are looked at at most, and views all round in which a splat's light is."""
CHOOSING = "finding how few splats do"
"""What pages know this stage by (client/src/enrolment/progressText.ts)."""
_LEAST_LIGHT_PX = 1e-3
_LOOKED_AT, _LOOKED_AT_MORE = [KINDS.index("face"), KINDS.index("hands")], 3.0
"""Whose light counts how much more."""


class SizedTrainer:
    """A `SplatTrainer` whose splats are merged on the way (a `Trainer`)."""

    def __init__(
        self,
        trainer: SplatTrainer,
        size: Size,
        should_stop: Callable[[], bool] = lambda: False,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """`should_stop`: whether to leave off looking for the number, for the training is about to
        be stopped; it looks anew when the training goes on. `tell`: hears of each number that is
        tried, which takes seconds."""
        self._trainer, self._size = trainer, size
        self._should_stop, self._tell = should_stop, tell
        self._steps, self._report = 0, dict[str, Any]()
        # those of sides and hair come after the choice, beyond any number that was asked for
        trainer.adds_sides = size == "auto"

    def warm_up(self) -> None:
        """As of the trainer."""
        self._trainer.warm_up()

    def before_step(self, fraction: float) -> None:
        """Choose the number, late in the training: after splats were made finer, and before those
        of sides and hair come."""
        if not self._report and fraction >= _SIZED_FROM and not self._should_stop():
            self._trainer.before_step(_SIZED_FROM)
            self._report = self._choose(fraction)
        self._trainer.before_step(fraction)

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

    def halve_learning_rate(self) -> None:
        """As of the trainer."""
        self._trainer.halve_learning_rate()

    def finish(self, metrics: dict[str, Any]) -> SplatModel:
        """The model; its metrics tell under `size` what was tried, and what it cost."""
        return self._trainer.finish({**metrics, "size": self._report})

    def _choose(self, fraction: float) -> dict[str, Any]:
        """Merge; returns the report, which is empty where it was told to leave off."""
        trainer = self._trainer
        some = np.linspace(0, trainer.frames - 1, min(trainer.frames, WATCHED)).astype(int)
        watched = WatchedFrames(trainer, tuple(some.tolist()))
        count = len(trainer.splats)
        if isinstance(self._size, int):
            for grouping in self._groupings(watched, [self._size] * (count > self._size)):
                trainer.merge(grouping)
            return {"asked": self._size, "of": count, "kept": len(trainer.splats)}
        rungs = int(np.log(count / _LEAST) / -np.log(_LADDER))
        counts = [round(count * _LADDER**rung) for rung in range(1, rungs + 1)]
        tried = self._bisect([None, *self._groupings(watched, counts)], watched, fraction)
        if tried is None:
            return {}
        return {
            "asked": "auto",
            "of": count,
            "kept": len(trainer.splats),
            "frames": len(some),
            "tried": tried,
            "steps": self._refit_steps * (len(tried) + 1),
        }

    @property
    def _refit_steps(self) -> int:
        return int(np.clip(_REFIT_SHARE * self._steps, *REFIT_STEPS))

    def _bisect(
        self, ladder: list[Grouping | None], watched: WatchedFrames, fraction: float
    ) -> list[dict[str, Any]] | None:
        """Go on with the last of `ladder` that is no worse than the first, all splats; what was
        tried. None, with all as before, where it was told to leave off."""
        trainer, before = self._trainer, self._trainer.state()

        def errors(grouping: Grouping | None, others: Sequence[Array] = ()) -> Errors:
            trainer.restore(before)
            count = len(trainer.splats)
            if grouping is not None:
                trainer.merge(grouping)
            self._tell(f"{CHOOSING} ({len(trainer.splats):,} of {count:,} tried)")
            for _ in range(self._refit_steps):
                trainer.learn(_again(fraction))
            return watched.errors(others)

        of_all, from_beside = errors(None), watched.from_beside()
        best, good, bad, tried = trainer.state(), 0, len(ladder), list[dict[str, Any]]()
        while bad - good > 1:
            if self._should_stop():
                trainer.restore(before)
                return None
            rung = (good + bad) // 2
            found = errors(ladder[rung], from_beside)
            good_enough = found.as_good_as(of_all)
            lost = {**found.lost(of_all), "apart": round(found.apart, 4)}
            tried.append({"splats": len(trainer.splats), **lost, "good": good_enough})
            if good_enough:
                best, good = trainer.state(), rung
            else:
                bad = rung
        trainer.restore(best)
        return tried

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
