"""What is changed about a training, one thing at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import numpy as np

from renderer.splats.settings import Size, SplatSettings
from scene.expression import blend_shape_weights
from scene.sequence import Sequence

NUMBERS = (250, 1000, 4000, 16_000, 64_000, 100_000)
"""Of splats, placed so from the start."""
PICTURES_PX = (64, 128)
"""Longest side of the pictures that a step sees, in place of 512."""
SEEDS = (0, 1)
"""Of each ablation, and of what it is compared with."""
Patches = tuple[tuple[str, Any], ...]
"""Dotted names of functions and constants, each with what stands in its place."""


@dataclass(frozen=True)
class Rung:
    """One way to train."""

    group: str
    """`number`, `pictures`, `expressions`, `size` or `without`."""
    name: str
    settings: Callable[[SplatSettings], SplatSettings] = lambda settings: settings
    clip: Callable[[Sequence], Sequence] = lambda clip: clip
    find_light: bool = True
    size: Size = "full"
    seeds: tuple[int, ...] = (0,)
    real_alone: bool = False
    """It changes nothing where poses are exact or splats few."""
    patches: Patches = ()
    """Of what no setting switches off."""
    captured_anew: bool = False
    """The patches are of the capture: the training's clip is captured by what they leave of it."""
    from_filling: bool = False
    """It changes nothing before unseen sides are filled: all such go on from one training."""


@contextmanager
def patched(patches: Patches) -> Iterator[None]:
    """Run with `patches` in place; a name that is not there raises AttributeError."""
    with ExitStack() as stack:
        for name, value in patches:
            stack.enter_context(mock.patch(name, value))
        yield


def _set(**changes: Any) -> Callable[[SplatSettings], SplatSettings]:
    return lambda settings: replace(settings, **changes)


def _no_expressions(clip: Sequence) -> Sequence:
    motion = replace(clip.motion, expressions=np.zeros_like(clip.motion.expressions))
    return replace(clip, body=replace(clip.body, expression_directions=None), motion=motion)


def _half_the_expressions(clip: Sequence) -> Sequence:
    """Those that the clip shows most; the others stay at rest."""
    directions, expressions = clip.body.expression_directions, clip.motion.expressions
    order = np.argsort(-np.abs(expressions).mean(axis=0), kind="stable")
    kept = np.zeros(len(order))
    kept[order[: len(order) // 2]] = 1.0
    if directions is not None:
        moved = blend_shape_weights(0.5 * kept) > 0.0
        directions = directions * moved[:, None, None]
    body = replace(clip.body, expression_directions=directions)
    return replace(clip, body=body, motion=replace(clip.motion, expressions=kept * expressions))


def _number(count: int) -> Rung:
    # coarse splats first, as always, but for few
    return Rung("number", str(count), _set(count=count, most=count))


def _pictures(side: int) -> Rung:
    return Rung("pictures", str(side), _set(whole_px=side))


def _without(name: str, *, real_alone: bool = False, **changes: Any) -> Rung:
    return Rung("without", name, _set(**changes), seeds=SEEDS, real_alone=real_alone)


AS_IT_IS = Rung("size", "full", seeds=SEEDS)
LADDER = (
    AS_IT_IS,
    Rung("size", "auto", size="auto", seeds=SEEDS),
    *(_number(count) for count in NUMBERS),
    *(_pictures(side) for side in PICTURES_PX),
    Rung("expressions", "half", clip=_half_the_expressions, real_alone=True),
    replace(AS_IT_IS, group="without", name="light of the clip", find_light=False),
    replace(AS_IT_IS, group="without", name="expressions", clip=_no_expressions, real_alone=True),
    _without("density where frames look", real_alone=True, unseen_density=1e9),
    _without("density of face and hands", real_alone=True, expressive_density=1.0),
    _without("coarse splats first", real_alone=True, densified_above=10**9),
    _without("pull to the surface", real_alone=True, shape_pull=0.0, head_shape_pull=0.0),
    _without("limit of roughness", real_alone=True, roughness_m=np.inf),
    _without("filling at 80 %", filled_from=2.0),
    _without("flat splats", thickness=1.0),
    _without("robust loss", linear_from=1.0, uncertain_linear_from=1.0),
    _without("falling rates", last_rate_share=1.0),
)
QUICK = (AS_IT_IS, Rung("size", "auto", size="auto"), _number(500))
