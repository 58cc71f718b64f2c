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

from capture.body.landmark_names import LANDMARK_NAMES
from capture.body.model import BodyModel
from capture.detection.face_and_hands import ClipParts
from capture.detection.landmarks import Landmarks
from capture.detection.lifter import Lifter, closed_form
from capture.errors import CaptureStopped, NoPersonFound
from capture.fitting.interpolation import interpolate_poses
from capture.fitting.observations import Observations, observe
from capture.fitting.optimiser import Descent
from capture.fitting.result import Fit
from capture.fitting.state import FitBody, FitState, PosedClip, initial_state, outlying
from capture.fitting.term import Term
from capture.fitting.terms import IMAGE_TERMS, LANDMARK_TERMS
from capture.fitting.terms.floor import floor_of
from capture.fitting.terms.silhouette import FAR_OFF, SilhouetteDistance
from scene.arrays import Array, Bool, Float, Int, Tensor, UInt8

STAGES = ("lifted", "landmarks", "silhouette", "second look")
"""What the fit does, in order. Before either stage with silhouettes, frames in which the body lies
far off theirs start again from their neighbours."""

LANDMARK_STEPS, _LANDMARK_RATE = 260, 0.03
SILHOUETTE_STEPS, _SILHOUETTE_RATE = 240, 0.03
_ASSOCIATE_EVERY = 8
"""Steps between pairings of pictures and body."""
_OUTLIER_CONFIDENCE = 0.1
"""In what the estimator says of a frame that its silhouette contradicts."""


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
    parts: ClipParts | None = None,
    on_progress: Callable[[float], None] = lambda _: None,
    on_stage: Callable[[str, Fit], None] = lambda *_: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Fit:
    """Fit `model` to one person's landmarks and masks over a clip (None: lost frames, bridged).

    `focal_px` is in pixels of the masks; None estimates it about that of usual cameras. `height_m`
    is the person's, barefoot; None guesses it, and with it how far away they are, which one camera
    can't tell. `lifter` is what the landmarks' estimator is believed to mean by them, to start
    from. `images` are the frames' pictures; without them nothing is known of motion but what
    landmarks say. `parts` are faces and hands, as far as anybody looked at them. `on_stage` is
    shown what each of `STAGES` made of the clip, so that its worth can be measured. The same input
    gives the same result.

    Raises NoPersonFound for a clip without a person, CaptureStopped when asked to stop.
    """
    found = np.array([index for index, person in enumerate(people) if person is not None])
    if not len(found):
        raise NoPersonFound("a fit must be given a person; got none in any frame")
    seen = observe(
        [person for person in people if person is not None],
        [masks[index] for index in found],
        times_s[found],
        np.asarray(takes)[found],
        lifter,
        focal_px=focal_px,
        images=None if images is None else [images[index] for index in found],
        parts=None if parts is None else parts.at(found.tolist()),
    )
    fit = ClipFit(model, seen)

    def result() -> Fit:
        return _with_lost_frames(fit.result(height_m), found, times_s)

    with _one_thread():
        _minimise(fit, on_progress, lambda stage: on_stage(stage, result()), should_stop)
    return result()


class ClipFit:
    """One clip's state, the observations it is to explain, and the terms between them."""

    def __init__(self, model: BodyModel, seen: Observations) -> None:
        self.body, self.seen = FitBody(model), seen
        self.state: FitState = initial_state(self.body, seen)
        self.silhouette = SilhouetteDistance(self.body, seen)
        self.landmark_terms: list[Term] = [term(self.body, seen) for term in LANDMARK_TERMS]
        others = [term(self.body, seen) for term in IMAGE_TERMS]
        self.image_terms: list[Term] = [self.silhouette, *others]

    def clip(self) -> PosedClip:
        """The body as the present state poses it."""
        return PosedClip(self.state, self.body, self.seen)

    def energy(self, *, pictures: bool) -> Float[Tensor, ""]:
        """The weighted sum of the terms, with those that look at pictures or without."""
        clip = self.clip()
        terms = self.landmark_terms + self.image_terms if pictures else self.landmark_terms
        return torch.stack([term.weight * term.energy(clip) for term in terms]).sum()

    @torch.no_grad()
    def prepare(self, *, coarse: bool) -> None:
        """Begin a stage that looks at pictures."""
        clip = self.clip()
        for term in self.landmark_terms + self.image_terms:
            term.prepare(clip, coarse=coarse)

    @torch.no_grad()
    def associate(self) -> None:
        """Pair pictures with the present body."""
        clip = self.clip()
        for term in self.landmark_terms + self.image_terms:
            term.associate(clip)

    @torch.no_grad()
    def outlier_frames(self) -> Bool[Array, "F"]:
        """Frames whose silhouette lies far off the body's, beside the others' of the clip."""
        clip = self.clip()
        self.silhouette.associate(clip)
        return outlying(self.silhouette.frame_energies(clip).numpy(), FAR_OFF)

    def reinitialise(self, frames: Bool[Array, "F"]) -> None:
        """Take the poses of `frames` from their neighbours in the same take, and hardly believe
        any more what the estimator says of them."""
        state, seen = self.state, self.seen
        angles = state.whole_angles()
        pelvis = state.pelvis.detach().numpy()
        for take in np.unique(seen.takes[frames]):
            here = np.flatnonzero(seen.takes == take)
            kept, outliers = here[~frames[here]], here[frames[here]]
            if not len(kept):
                continue
            between = interpolate_poses(kept, angles[kept], pelvis[kept], seen.times_s)
            state.set_poses(outliers, *(values[outliers] for values in between))
            state.frame_confidence[outliers] = _OUTLIER_CONFIDENCE

    @torch.no_grad()
    def result(self, height_m: float | None) -> Fit:
        """The fit, as tall as `height_m` where that is known."""
        state, model, clip = self.state, self.body.model, self.clip()
        error = clip.reprojection_error_px.norm(dim=-1).numpy().astype(np.float64)
        weights = self.seen.landmark_weights.numpy().astype(np.float64)
        shape, floor = state.shape.numpy().astype(np.float64), floor_of(state)
        tall = np.ptp(model.rest_vertices[:, 1] + model.vertex_directions[:, 1] @ shape)
        # scaled about the camera, so that pictures stay the same
        scale = 1.0 if height_m is None else height_m / float(tall)
        return Fit(
            model.body(shape, scale),
            float(clip.focal_px),
            state.whole_angles(),
            scale * state.pelvis.numpy().astype(np.float64),
            np.where(weights > 0.0, error, np.nan),
            weights,
            None if floor is None else floor * [1.0, 1.0, 1.0, scale],
            state.up.numpy().astype(np.float64),
        )


def _with_lost_frames(fit: Fit, found: Int[Array, "N"], times_s: Float[Array, "F"]) -> Fit:
    """`fit` of the `found` frames for all: poses of lost ones are interpolated, nothing is seen."""
    angles, pelvis = interpolate_poses(found, fit.joint_angles, fit.pelvis, times_s)
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
    fit: ClipFit,
    on_progress: Callable[[float], None],
    on_stage: Callable[[str], None],
    should_stop: Callable[[], bool],
) -> None:
    """First landmarks alone, then pictures too, twice, each with a falling rate."""
    total = LANDMARK_STEPS + 2 * SILHOUETTE_STEPS
    done = 0
    on_stage(STAGES[0])
    for stage in STAGES[1:]:
        pictures = stage != STAGES[1]
        steps, rate = (
            (SILHOUETTE_STEPS, _SILHOUETTE_RATE) if pictures else (LANDMARK_STEPS, _LANDMARK_RATE)
        )
        if pictures:
            fit.reinitialise(fit.outlier_frames())
            fit.prepare(coarse=stage == STAGES[2])
        descent = Descent(fit.state, fit.seen, rate)
        for step in range(steps):
            if should_stop():
                raise CaptureStopped("capture was stopped while fitting the body")
            if pictures and step % _ASSOCIATE_EVERY == 0:
                fit.associate()
            descent.step(fit.energy(pictures=pictures), step / steps)
            done += 1
            on_progress(done / total)
        on_stage(stage)
