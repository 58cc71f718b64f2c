"""Trains a model further, and holds it to the one that it goes on from.

Frames that both know are held out of this training. Where in the end they come out worse than the
earlier model has them, what was learnt is not worth it.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np

from renderer.errors import ForgotTooMuch
from renderer.splats.model import SplatModel
from renderer.splats.training.trainer import SplatTrainer
from renderer.splats.training.watched_frames import Errors, WatchedFrames
from scene.arrays import Array, Float

_LEARNS_FROM = 0.4
"""Share of the training whose rates it begins with: at first rates, what is known is blurred before
it is learnt again."""
_MOST, _SHARE, _LEAST_FRAMES = 8, 8, 20
"""Frames held out at most, one in so many, of clips that have at least so many."""


class HeldToTrainer:
    """A `SplatTrainer` whose model must stay as good as the one it starts from (a `Trainer`)."""

    def __init__(self, trainer: SplatTrainer, known_frames: int) -> None:
        """`known_frames`: so many of its frames, the first, are those that must come out well."""
        self._trainer = trainer
        trainer.held_out = held_out_frames(known_frames)
        self._watched = WatchedFrames(trainer, trainer.held_out)
        self._before = self._watched.errors()

    def warm_up(self) -> None:
        """As of the trainer."""
        self._trainer.warm_up()

    def before_step(self, fraction: float) -> None:
        """As of the trainer."""
        self._trainer.before_step(fraction)

    def step(self, fraction: float) -> float:
        """As of the trainer, at the rates of one that has come some way."""
        return self._trainer.step(_LEARNS_FROM + (1.0 - _LEARNS_FROM) * fraction)

    def preview(self) -> Float[Array, "H W 3"]:
        """As of the trainer."""
        return self._trainer.preview()

    def state(self) -> dict[str, Array]:
        """The trainer's, and how good the earlier model was."""
        return {**self._trainer.state(), "held_to": np.array(json.dumps(asdict(self._before)))}

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`."""
        self._trainer.restore(state)
        self._before = Errors(**json.loads(str(state["held_to"])))

    def halve_learning_rate(self) -> None:
        """As of the trainer."""
        self._trainer.halve_learning_rate()

    def finish(self, metrics: dict[str, Any]) -> SplatModel:
        """The model; its metrics tell under `held_to` what became of the frames held out.

        Raises ForgotTooMuch where they are worse than the tolerances of `watched_frames` allow.
        """
        model, after = self._trainer.finish(metrics), self._watched.errors()
        lost = after.lost(self._before)
        if not after.as_good_as(self._before):
            raise ForgotTooMuch(
                "a model that learns more must show what it knew as well as before; got "
                f"{_words(lost)} on {len(self._trainer.held_out)} frames of the clip; the earlier "
                "model stays; learn from pictures in the light and clothes of the clip, or record "
                "a new one"
            )
        model.metrics["held_to"] = lost
        return model


def held_out_frames(count: int) -> tuple[int, ...]:
    """Some of `count` frames, spread evenly; none of a short clip."""
    some = min(_MOST, count // _SHARE) if count >= _LEAST_FRAMES else 0
    return tuple(((np.arange(some) + 0.5) / max(some, 1) * count).astype(int).tolist())


def _words(lost: dict[str, Any]) -> str:
    db = ", ".join(f"{name} {value:+.2f} dB" for name, value in lost["lost_db"].items())
    lpips = ", ".join(
        f"{name} {before:.3f} to {after:.3f}" for name, (before, after) in lost["lpips"].items()
    )
    return f"errors of {db}; LPIPS of {lpips}"
