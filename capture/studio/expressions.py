"""Random expressions of a performer's face and hands: talking, blinking, smiling, looking about,
gestures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scene.arrays import Array, Float
from scene.expression import (
    EXPRESSION_COUNT,
    EXPRESSION_NAMES,
    FINGERS,
    GAZE,
    PARTS,
    gaze_numbers,
)
from scene.motion import Motion

_PERIODS_S = {
    "jaw_open": (0.35, 1.1),
    "brows_up": (1.5, 4.0),
    "smile": (2.0, 5.0),
}
"""Shortest and longest period of the sine waves whose sum each expression is."""
_WAVES = 4
_FIXATION_S = 0.7
"""How long eyes rest on one place."""
_FARTHEST_GAZE_RAD = 0.35
"""How far they turn aside."""
_BLINK_INTERVAL_S = 1.6
_BLINK_S = 0.12
"""Standard deviation of a blink in time: it takes about 0.3 s."""
_WINK_SHARE = 0.5
"""Share of blinks of one eye alone: more than people wink, so that the eyes are told apart."""
_GESTURES = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [1.0, 1.0, 1.0, 1.0, 1.0],
        [1.0, 0.0, 1.0, 1.0, 1.0],
        [1.0, 0.0, 0.0, 1.0, 1.0],
        [1.0, 0.0, 0.0, 0.0, 1.0],
        [0.0, 1.0, 1.0, 1.0, 1.0],
    ]
)
"""Curls of the fingers, thumb first: flat, a fist, pointing, counting two and three, thumb up."""
_GESTURE_SHARE = 0.6
"""Of what a hand does; else each finger bends as it likes."""
_GESTURE_S = (0.6, 1.4)
"""Shortest and longest time from one to the next."""


def with_random_expressions(motion: Motion, seed: int) -> Motion:
    """`motion` with expressions drawn from `seed`: smooth, each between 0 and 1."""
    rng = np.random.default_rng(seed)
    expressions = np.zeros((len(motion), EXPRESSION_COUNT))
    for name, periods in _PERIODS_S.items():
        expressions[:, EXPRESSION_NAMES.index(name)] = _waves(motion.times_s, periods, rng)
    for hand in ("left_hand", "right_hand"):
        expressions[:, PARTS[hand]] = _gestures(motion.times_s, rng)
    left, right = (EXPRESSION_NAMES.index(f"blink_{side}") for side in ("left", "right"))
    _blink(expressions, left, right, motion.times_s, rng)
    fixation = np.floor((motion.times_s - motion.times_s[0]) / _FIXATION_S + 1e-6).astype(int)
    places = _FARTHEST_GAZE_RAD * rng.uniform(-1.0, 1.0, fixation[-1] + 1)
    expressions[:, GAZE] = gaze_numbers(places[fixation])
    return replace(motion, expressions=expressions)


def _waves(
    times_s: Float[Array, "F"], periods: tuple[float, float], rng: np.random.Generator
) -> Float[Array, "F"]:
    rates = 2.0 * np.pi / rng.uniform(*periods, _WAVES)
    phases = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    wave = np.sin(times_s[:, None] * rates + phases).mean(axis=1)
    return np.clip(0.4 + 1.3 * wave, 0.0, 1.0)


def _gestures(times_s: Float[Array, "F"], rng: np.random.Generator) -> Float[Array, "F 5"]:
    """Curls of one hand's fingers: from one gesture smoothly to the next."""
    begun_s, curls = [times_s[0] - rng.uniform(0.0, _GESTURE_S[0])], [_gesture(rng)]
    while begun_s[-1] <= times_s[-1]:
        begun_s.append(begun_s[-1] + rng.uniform(*_GESTURE_S))
        curls.append(_gesture(rng))
    begun, shown = np.array(begun_s), np.array(curls)
    before = np.searchsorted(begun, times_s, side="right") - 1
    share = (times_s - begun[before]) / (begun[before + 1] - begun[before])
    smooth = (share * share * (3.0 - 2.0 * share))[:, None]
    return shown[before] + smooth * (shown[before + 1] - shown[before])


def _gesture(rng: np.random.Generator) -> Float[Array, "5"]:
    if rng.uniform() < _GESTURE_SHARE:
        return _GESTURES[rng.integers(len(_GESTURES))]
    return np.clip(rng.uniform(-0.4, 1.2, len(FINGERS)), 0.0, 1.0)


def _blink(
    expressions: Float[Array, "F E"],
    left: int,
    right: int,
    times_s: Float[Array, "F"],
    rng: np.random.Generator,
) -> None:
    blink_time_s = times_s[0] + rng.uniform(0.0, _BLINK_INTERVAL_S)
    while blink_time_s < times_s[-1]:
        closed = np.exp(-0.5 * ((times_s - blink_time_s) / _BLINK_S) ** 2)
        draw = rng.uniform()
        eyes = (
            (left, right)
            if draw > _WINK_SHARE
            else (left,)
            if draw < 0.5 * _WINK_SHARE
            else (right,)
        )
        for eye in eyes:
            expressions[:, eye] = np.maximum(expressions[:, eye], closed)
        blink_time_s += rng.uniform(0.5, 1.5) * _BLINK_INTERVAL_S
