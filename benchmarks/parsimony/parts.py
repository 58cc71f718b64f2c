"""The parts of the method that real people's quality rests on, each left out alone.

Those that a setting or the clip can do without are told so; of the others a function or a constant
is patched. A part of the capture has the training's clip captured anew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.parsimony.rungs import AS_IT_IS, Patches, Rung
from renderer.splats.settings import SplatSettings
from renderer.splats.training.hair import Hair
from scene.expression import GAZE
from scene.sequence import Sequence

LIFELIKE = ("hazel", "jasper")
REAL = ("grey-shirt", "orange-hoodie")
_TRAINING, _FIT = "renderer.splats.training", "capture.fitting.terms.part_poses"


WHOLE = replace(AS_IT_IS, from_filling=True)


@dataclass(frozen=True)
class MethodPart:
    """One part, and whom it is judged on."""

    rung: Rung
    people: tuple[str, ...]


def _without(name: str, people: tuple[str, ...], **changes: Any) -> MethodPart:
    return MethodPart(replace(AS_IT_IS, group="without", name=name, **changes), people)


def _of_training(name: str, people: tuple[str, ...], where: str, instead: Any) -> MethodPart:
    return _without(name, people, patches=((f"{_TRAINING}.{where}", instead),))


def _of_unseen_sides(name: str, people: tuple[str, ...], where: str, instead: Any) -> MethodPart:
    part = _of_training(name, people, where, instead)
    return replace(part, rung=replace(part.rung, from_filling=True))


def _of_capture(name: str, people: tuple[str, ...], where: str, instead: Any) -> MethodPart:
    patches: Patches = ((where, instead),)
    return _without(name, people, patches=patches, captured_anew=True)


def _alone(settings: SplatSettings) -> SplatSettings:
    return replace(settings, beside_share=0.0)


def _looking_ahead(clip: Sequence) -> Sequence:
    expressions = clip.motion.expressions.copy()
    expressions[:, GAZE] = 0.0
    return replace(clip, motion=replace(clip.motion, expressions=expressions))


def _none_of(rows: Any, *_: Any) -> Any:
    """As many as `rows`, nothing of each."""
    return np.zeros(len(rows), bool)


PARTS = (
    _of_unseen_sides(
        "cloth over hollows",
        LIFELIKE,
        "trained_splats.spanned",
        lambda rest, *_: np.zeros_like(rest),
    ),
    _of_unseen_sides("mirrored guesses", LIFELIKE, "filling._MIRRORED_M", np.inf),
    _of_unseen_sides(
        "colours held at rims",
        (*LIFELIKE, *REAL),
        "trainer.held_colours",
        lambda evidence, *_: ~evidence.seen,
    ),
    _of_unseen_sides("finer sides", ("hazel",), "trainer.wide_on_unseen_sides", _none_of),
    _of_unseen_sides(
        "hair's volume",
        ("hazel",),
        "unseen_sides.hair_of_unseen_sides",
        lambda _, surface, *__: Hair.none(len(surface)),
    ),
    _of_unseen_sides("strands", ("hazel",), "trainer.with_strands", lambda model, _: model),
    _of_unseen_sides(
        "guessed colours", ("hazel",), "unseen_sides.fill_unseen", lambda found, *_: found
    ),
    _without("looking from beside", (*LIFELIKE, "grey-shirt"), settings=_alone),
    _of_training(
        "what limbs may hide",
        REAL,
        "frame_drawing.hidden_by_limbs",
        lambda _, limbs, *__: _none_of(limbs),
    ),
    _of_training(
        "registered frames",
        ("jasper", *REAL),
        "step_views.StepViews.should_register",
        lambda *_: False,
    ),
    _of_unseen_sides("fingers of skin", REAL, "frame_drawing.strays_on_hands", _none_of),
    _of_training("smooth hands", REAL, "trained_splats.TrainedSplats.pull_hands", lambda *_: None),
    _of_training("fingers bent", REAL, "finger_bends.FingerBends.learn", lambda *_: None),
    _without("gaze", ("grey-shirt",), clip=_looking_ahead),
    _of_capture("palms in the picture", ("orange-hoodie",), f"{_FIT}.PALM_WEIGHT", 0.0),
    _of_capture(
        "a face of one's own",
        ("grey-shirt",),
        "capture.pipeline.with_own_face",
        lambda body, *_: body,
    ),
    _of_capture(
        "matte of the edge",
        ("grey-shirt",),
        "capture.segmentation.masks._matted",
        lambda _, soft: soft,
    ),
    _of_capture(
        "evened exposure",
        ("patterned-shirt",),
        "capture.pipeline.find_gains",
        lambda images, _: np.ones((len(images), 3)),
    ),
    _of_training("cloth that swings", ("amber",), "loose_clothes.find_cut", lambda _: None),
)
"""Those that are likeliest to be worth nothing come first."""
