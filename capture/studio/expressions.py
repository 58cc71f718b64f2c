"""Random expressions of a performer's face and hands: talking, blinking, smiling, fists."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scene.arrays import Array, Float
from scene.expression import EXPRESSION_COUNT, EXPRESSION_NAMES
from scene.motion import Motion

_PERIODS_S = {
    "jaw_open": (0.35, 1.1),
    "brows_up": (1.5, 4.0),
    "smile": (2.0, 5.0),
    "left_hand_curl": (1.5, 4.0),
    "right_hand_curl": (1.5, 4.0),
}
"""Shortest and longest period of the sine waves whose sum each expression is."""
_WAVES = 4
_BLINK_INTERVAL_S = 1.6
_BLINK_S = 0.12
"""Standard deviation of a blink in time: it takes about 0.3 s."""
_WINK_SHARE = 0.5
"""Share of blinks of one eye alone: more than people wink, so that the eyes are told apart."""


def with_random_expressions(motion: Motion, seed: int) -> Motion:
    """`motion` with expressions drawn from `seed`: smooth, each between 0 and 1."""
    rng = np.random.default_rng(seed)
    expressions = np.zeros((len(motion), EXPRESSION_COUNT))
    for name, periods in _PERIODS_S.items():
        expressions[:, EXPRESSION_NAMES.index(name)] = _waves(motion.times_s, periods, rng)
    left, right = (EXPRESSION_NAMES.index(f"blink_{side}") for side in ("left", "right"))
    _blink(expressions, left, right, motion.times_s, rng)
    return replace(motion, expressions=expressions)


def _waves(
    times_s: Float[Array, "F"], periods: tuple[float, float], rng: np.random.Generator
) -> Float[Array, "F"]:
    rates = 2.0 * np.pi / rng.uniform(*periods, _WAVES)
    phases = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    wave = np.sin(times_s[:, None] * rates + phases).mean(axis=1)
    return np.clip(0.4 + 1.3 * wave, 0.0, 1.0)


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
