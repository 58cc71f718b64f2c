"""The clip-wide fit: one body shape, one camera and a smooth motion that explain a whole clip.

SPIN's idea (Kolotouros et al. 2019) of regression followed by optimisation: a network lifts each
frame's landmarks to a pose (`capture.detection.lifter`), then everything is refined together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import torch

from capture.body.model import BodyModel
from capture.detection.landmarks import LANDMARK_NAMES, Landmarks
from capture.detection.lifter import Lifter, closed_form
from capture.errors import CaptureStopped, NoPersonFound
from capture.fitting.observations import Fit, bridged
from capture.fitting.optimiser import Descent
from capture.fitting.state import Problem
from scene.arrays import Array, Float, UInt8

__all__ = ["STAGES", "Fit", "fit_clip"]

STAGES = ("lifted", "landmarks", "silhouette", "second look")
"""What the fit does, in order. Before each look at the silhouettes, frames in which the person
lies far off theirs are let go and begun anew from their neighbours."""

_LANDMARK_STEPS, _LANDMARK_RATE = 260, 0.03
_SILHOUETTE_STEPS, _SILHOUETTE_RATE = 240, 0.03
_NEAREST_EVERY = 8


def fit_clip(
    people: Sequence[Landmarks | None],
    masks: Sequence[Float[Array, "H W"] | None],
    times_s: Float[Array, "F"],
    takes: Sequence[int],
    model: BodyModel,
    *,
    focal_px: float | None = None,
    height_m: float | None = None,
    lifter: Lifter = closed_form,
    images: Sequence[UInt8[Array, "H W 3"]] | None = None,
    on_progress: Callable[[float], None] = lambda _: None,
    on_stage: Callable[[str, Fit], None] = lambda *_: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Fit:
    """Fit `model` to one person's landmarks and masks over a clip (None: lost frames, bridged).

    `focal_px` is in pixels of the masks; None estimates it about that of usual cameras. `height_m`
    is the person's, barefoot; None guesses it, and with it how far away they are, which one camera
    can't tell. `lifter` is what the landmarks' estimator is believed to mean by them, to start
    from. `images` are the frames' pictures; without them nothing is known of motion but what
    landmarks say. `on_stage` is shown what each of `STAGES` made of the clip, so that its worth can
    be measured. The same input gives the same result.

    Raises NoPersonFound for a clip without a person, CaptureStopped when asked to stop.
    """
    found = [index for index, person in enumerate(people) if person is not None]
    if not found:
        raise NoPersonFound("a fit must be given a person; got none in any frame")
    problem = Problem(
        [person for person in people if person is not None],
        [masks[index] for index in found],
        times_s[found],
        np.asarray(takes)[found],
        model,
        focal_px,
        height_m,
        lifter,
        None if images is None else [images[index] for index in found],
    )

    def result() -> Fit:
        return _with_lost_frames(problem.result(), np.array(found), times_s)

    with _one_thread():
        _minimise(problem, on_progress, lambda stage: on_stage(stage, result()), should_stop)
    return result()


def _with_lost_frames(fit: Fit, found: Array, times_s: Array) -> Fit:
    """`fit` of the `found` frames, spread to all: lost ones are bridged and trusted in nothing."""
    angles, pelvis = bridged(found, fit.joint_angles, fit.pelvis, times_s)
    error = np.full((len(times_s), len(LANDMARK_NAMES)), np.nan)
    weights = np.zeros_like(error)
    error[found], weights[found] = fit.landmark_error_px, fit.weights
    return replace(
        fit, joint_angles=angles, pelvis=pelvis, landmark_error_px=error, weights=weights
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """The tensors are small: threads only wait for each other, seventeen times as long if busy.

    Subnormal numbers, which fading gradients become, would be as slow again.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_num_threads(before)
        torch.set_flush_denormal(False)


def _minimise(
    problem: Problem,
    on_progress: Callable[[float], None],
    on_stage: Callable[[str], None],
    should_stop: Callable[[], bool],
) -> None:
    """First landmarks alone, then silhouette and flow too, twice, each with a falling rate."""
    total = _LANDMARK_STEPS + 2 * _SILHOUETTE_STEPS
    done = 0
    on_stage(STAGES[0])
    for stage in STAGES[1:]:
        edge = stage != STAGES[1]
        steps, rate = (
            (_SILHOUETTE_STEPS, _SILHOUETTE_RATE) if edge else (_LANDMARK_STEPS, _LANDMARK_RATE)
        )
        if edge:
            problem.let_go(problem.doubted())
            problem.watch(coarse=stage == STAGES[2])
        descent, look = Descent(problem, rate), None
        for step in range(steps):
            if should_stop():
                raise CaptureStopped("capture was stopped while fitting the body")
            if edge and step % _NEAREST_EVERY == 0:
                look = problem.look()
            descent.step(problem.energy(look), step / steps)
            done += 1
            on_progress(done / total)
        on_stage(stage)
