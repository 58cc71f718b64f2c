"""The training loop that every model shares: budget, progress, checkpoints, and what goes wrong.

A model's own part is a `Trainer`: one step at a time, its state as plain arrays. The loop measures
time by the clock it is given, keeps the last good state, rolls back when training diverges (halving
the rates, thrice, then failing with the reason), and leaves a checkpoint that a later call resumes.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np

from renderer.errors import OutdatedCheckpoint, TrainingError, TrainingStopped
from renderer.field.settings import FieldSettings
from renderer.performer_model import PerformerModel
from renderer.presets import Preset, find_preset
from renderer.splats.settings import Size
from scene.arrays import Array, Float
from scene.sequence import Sequence

REPORT_EVERY_S = 0.5
"""Least time between reports of progress."""
CHECKPOINT_EVERY_S = 10.0
"""Least time between checkpoints."""
_REST = 15.0
"""A report or a checkpoint is followed by at least so many times its own duration of training: a
preview of the largest preset takes seconds, its state is 760 MB."""
_STATE = "state."
"""Before the names of what is the trainer's in a checkpoint: they are its own affair."""
_ATTEMPTS = 3
"""How often a diverged run is rolled back before it fails."""
_CHECK_EVERY_STEPS = 20
"""Steps between looks at the clock's report, the state and the wish to stop."""


@dataclass(frozen=True, eq=False)
class Progress:
    """How far training has come."""

    step: int
    fraction: float
    """Share of the budget used, 0 to 1."""
    elapsed_s: float
    loss: float
    preview: Float[Array, "H W 3"] | None
    """sRGB picture of the model as it is now."""
    choosing: str = ""
    """What is tried between two steps, where that takes seconds."""

    @property
    def message(self) -> str:
        """What is going on in words, and the numbers for those who want them."""
        return self.choosing or f"learning the looks (step {self.step}, loss {self.loss:.4f})"


@runtime_checkable
class Trainer(Protocol):
    """One kind of model being trained."""

    def warm_up(self) -> None:
        """Compile whatever is compiled on first use; changes nothing else."""
        ...

    def before_step(self, fraction: float) -> None:
        """Called before the step at `fraction` for work other than training: its time is not
        counted."""
        ...

    def step(self, fraction: float) -> float:
        """One step at `fraction` of the schedule; returns the loss. One that is not finite means
        that training has diverged, or that the person has vanished."""
        ...

    def preview(self) -> Float[Array, "H W 3"]:
        """A picture of the model as it is now."""
        ...

    def state(self) -> dict[str, Array]:
        """Copies of everything that `restore` needs."""
        ...

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`."""
        ...

    def halve_learning_rate(self) -> None:
        """Halve all rates."""
        ...

    def finish(self, metrics: dict[str, Any]) -> PerformerModel:
        """The model, with `metrics` inside."""
        ...


def train(
    sequence: Sequence,
    *,
    preset: str | Preset = "splats",
    budget_s: float | None = None,
    iterations: int | None = None,
    seed: int = 0,
    lpips_backbone: Path | None = None,
    start: PerformerModel | None = None,
    find_light: bool = False,
    size: Size = "full",
    held_to: int = 0,
    on_progress: Callable[[Progress], None] = lambda _: None,
    should_stop: Callable[[], bool] = lambda: False,
    checkpoint: Path | None = None,
    clock: Callable[[], float],
) -> PerformerModel:
    """Train a model of the person in `sequence`.

    Args:
        preset: by name, or one with settings of its own.
        budget_s: training time (compilation, reading and looking for the light apart); schedules
            scale with it.
        iterations: a number of steps in its place: repeatable to the bit for one seed.
        lpips_backbone: weights for a perceptual loss, where the preset trains on patches. start: an
        earlier model of the person, of this clip or another, to go on from (splats). find_light:
        learn albedos, by the light that the clip was captured in (splats); seconds more. size: how
        many splats are kept; `auto`, as few as the clip shows a need for; a field has none.
        held_to: so many frames of the sequence, its first, that `start` knows too and must come out
        as well as of `start` (splats of full size); 0: none.
        checkpoint: where a stopped run is kept, and where this one goes on from if it is there.
        clock: monotonic seconds.
    Raises:
        UnknownPreset, TrainingError (diverged for good), ForgotTooMuch (see `held_to`),
        TrainingStopped (checkpoint written).
    """
    if (budget_s is None) == (iterations is None):
        raise TrainingError(
            f"either budget_s or iterations must be given; got {budget_s} and {iterations}"
        )
    chosen = find_preset(preset) if isinstance(preset, str) else preset

    def tell(choosing: str) -> None:
        on_progress(run.progress(choosing))

    trainer = _make_trainer(
        chosen,
        sequence,
        seed,
        lpips_backbone,
        start,
        find_light=find_light,
        size=size,
        held_to=held_to,
        should_stop=should_stop,
        tell=tell,
    )
    run = _Run(trainer, chosen.name, sequence.data_hash, seed)
    run.resume(checkpoint)
    run.trainer.warm_up()
    run.loop(budget_s, iterations, on_progress, should_stop, checkpoint, clock)
    return run.trainer.finish(
        {
            "steps": run.step,
            "train_seconds": round(run.elapsed_s, 3),
            "loss": round(run.loss, 6),
            "seed": seed,
            "rollbacks": run.rollbacks,
            "rollback_seconds": round(run.rollback_s, 3),
        }
    )


def _make_trainer(
    preset: Preset,
    sequence: Sequence,
    seed: int,
    lpips_backbone: Path | None,
    start: PerformerModel | None,
    *,
    find_light: bool,
    size: Size,
    held_to: int,
    should_stop: Callable[[], bool],
    tell: Callable[[str], None],
) -> Trainer:
    if lpips_backbone is not None and not preset.trains_on_patches:
        raise TrainingError(
            f"lpips_backbone must go with a preset that trains on patches, such as paper; "
            f"got {preset.name!r}; leave it out"
        )
    splats = None if start is None else start.splats
    if start is not None and (preset.is_field or splats is None):
        raise TrainingError(
            f"start must be a model of splats and go with the preset splats; got one of "
            f"{start.preset!r} and the preset {preset.name!r}; leave it out"
        )
    if isinstance(preset.settings, FieldSettings):
        from renderer.field.training.trainer import FieldTrainer

        settings = replace(preset.settings, lpips_backbone=lpips_backbone)
        return FieldTrainer(sequence, preset.name, settings, seed)
    from renderer.splats.training.trainer import SplatTrainer

    splat_trainer = SplatTrainer(sequence, preset.settings, seed, splats, find_light=find_light)
    if held_to:
        from renderer.splats.training.held_to import HeldToTrainer

        return HeldToTrainer(splat_trainer, held_to)
    if size == "full":
        return splat_trainer
    from renderer.splats.training.sized_trainer import SizedTrainer

    return SizedTrainer(splat_trainer, size, should_stop, tell)


@dataclass(frozen=True, eq=False)
class _Snapshot:
    """A state that a run can go back to."""

    state: dict[str, Array]
    step: int
    elapsed_s: float


class _Run:
    """A training run: its trainer and how far it has come."""

    def __init__(self, trainer: Trainer, preset: str, data_hash: str, seed: int) -> None:
        self.trainer, self.step, self.elapsed_s, self.loss = trainer, 0, 0.0, float("nan")
        self.fraction = 0.0
        self.rollbacks, self.rollback_s = 0, 0.0
        self._identity = {"preset": preset, "data_hash": data_hash, "seed": seed}

    def loop(
        self,
        budget_s: float | None,
        iterations: int | None,
        on_progress: Callable[[Progress], None],
        should_stop: Callable[[], bool],
        checkpoint: Path | None,
        clock: Callable[[], float],
    ) -> None:
        """Step until the budget is used."""
        started = clock() - self.elapsed_s
        last_check, report_due = self.elapsed_s, self.elapsed_s + REPORT_EVERY_S
        save_due = self.elapsed_s + CHECKPOINT_EVERY_S
        # two, since the newest may already be corrupt
        snapshots = deque([_Snapshot(self.trainer.state(), self.step, self.elapsed_s)], maxlen=2)
        while True:
            share = self.elapsed_s / budget_s if budget_s else self.step / (iterations or 1)
            self.fraction = min(1.0, share)
            if share >= 1.0:
                break
            begun = clock()
            self.trainer.before_step(share)
            started += clock() - begun
            self.loss = self.trainer.step(share)
            self.step += 1
            self.elapsed_s = clock() - started
            if not np.isfinite(self.loss):
                self._roll_back(snapshots)
                continue
            check_due = min(last_check + REPORT_EVERY_S, report_due)
            if self.step % _CHECK_EVERY_STEPS and self.elapsed_s < check_due:
                continue
            last_check = self.elapsed_s
            if should_stop():
                self.save(checkpoint)
                raise TrainingStopped(f"training was stopped at step {self.step}")
            if self.elapsed_s >= report_due:
                state = self.trainer.state()
                if not _is_finite(state):
                    self._roll_back(snapshots)
                    continue
                snapshots.append(_Snapshot(state, self.step, self.elapsed_s))
                on_progress(self.progress())
                report_due = _next_due(clock() - started, last_check, REPORT_EVERY_S)
            if self.elapsed_s >= save_due:
                begun = clock() - started
                self.save(checkpoint)
                save_due = _next_due(clock() - started, begun, CHECKPOINT_EVERY_S)
        if not _is_finite(self.trainer.state()):
            self.trainer.restore(snapshots[-1].state)
        on_progress(self.progress())

    def save(self, path: Path | None) -> None:
        """Write the checkpoint, whole or not at all."""
        if path is None:
            return
        about = {**self._identity, "step": self.step, "elapsed_s": self.elapsed_s}
        part = path.with_name(path.name + ".part")
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with part.open("wb") as file:
                state = {_STATE + name: value for name, value in self.trainer.state().items()}
                np.savez(file, about=np.array(json.dumps(about)), **cast(Any, state))
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)

    def resume(self, path: Path | None) -> None:
        """Go on from a checkpoint of the same clip, preset and seed, if there is one that this
        version can go on from."""
        if path is None or not path.exists():
            return
        try:
            with np.load(path, allow_pickle=False) as stored:
                arrays = dict(stored)
            about = json.loads(str(arrays.pop("about")))
        except (OSError, ValueError, KeyError, EOFError) as error:
            raise TrainingError(
                f"checkpoint must be a file of an earlier run; got {path}: {error}; delete it"
            ) from error
        if any(about.get(key) != value for key, value in self._identity.items()):
            raise TrainingError(
                f"checkpoint must be of the same clip, preset and seed; got {about}; "
                f"delete {path} to start anew"
            )
        anew = self.trainer.state()
        state = {name.removeprefix(_STATE): value for name, value in arrays.items()}
        try:
            self.trainer.restore(state)
        except OutdatedCheckpoint:
            # a training takes a minute: to begin it anew loses less than to fail it
            self.trainer.restore(anew)
            return
        self.step, self.elapsed_s = int(about["step"]), float(about["elapsed_s"])

    def _roll_back(self, snapshots: deque[_Snapshot]) -> None:
        self.rollbacks += 1
        if self.rollbacks > _ATTEMPTS:
            raise TrainingError(
                "training must stay finite and keep the person in sight; got a loss of "
                f"{self.loss} at step {self.step}, {_ATTEMPTS} times after halving the rates; "
                "look at the clip's masks and poses"
            )
        last = snapshots[-1] if len(snapshots) == 1 else snapshots.pop()
        self.step = last.step
        self.rollback_s += self.elapsed_s - last.elapsed_s
        self.trainer.restore(last.state)
        self.trainer.halve_learning_rate()

    def progress(self, choosing: str = "") -> Progress:
        """Where it is, with a picture."""
        picture = self.trainer.preview()
        return Progress(self.step, self.fraction, self.elapsed_s, self.loss, picture, choosing)


def _next_due(now_s: float, begun_s: float, least_s: float) -> float:
    """When the work that began at `begun_s` and has just ended is due again."""
    return now_s + max(least_s, _REST * (now_s - begun_s))


def _is_finite(state: dict[str, Array]) -> bool:
    return all(np.isfinite(a).all() for a in state.values() if a.dtype.kind == "f")
