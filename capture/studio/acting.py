"""What a performer's face and hands do while they move: talking, blinking, smiling, fists."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scene.arrays import Array, Float
from scene.expression import EXPRESSION_COUNT, EXPRESSION_NAMES
from scene.motion import Motion

_PERIODS_S = {"jaw_open": (0.35, 1.1), "brows_up": (1.5, 4.0), "smile": (2.0, 5.0),
              "left_hand_curl": (1.5, 4.0), "right_hand_curl": (1.5, 4.0)}  # fmt: skip
"""Shortest and longest period of the waves that each is a sum of."""
_WAVES = 4
_BLINKS_EVERY_S = 1.6
_BLINK_S = 0.12
"""Standard deviation of a blink in time: it takes about 0.3 s."""
_WINKS = 0.5
"""Share of the blinks of one eye alone: more than people wink, so that each eye shows its own."""


def acted(motion: Motion, seed: int) -> Motion:
    """`motion` with expressions drawn from `seed`: smooth, each from nil to one time and again."""
    rng = np.random.default_rng(seed)
    shown = np.zeros((len(motion), EXPRESSION_COUNT))
    for name, periods in _PERIODS_S.items():
        shown[:, EXPRESSION_NAMES.index(name)] = _waves(motion.times_s, periods, rng)
    left, right = (EXPRESSION_NAMES.index(f"blink_{side}") for side in ("left", "right"))
    _blink(shown, left, right, motion.times_s, rng)
    return replace(motion, expressions=shown)


def _waves(
    times_s: Float[Array, "F"], periods: tuple[float, float], rng: np.random.Generator
) -> Float[Array, "F"]:
    rates = 2.0 * np.pi / rng.uniform(*periods, _WAVES)
    phases = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    wave = np.sin(times_s[:, None] * rates + phases).mean(axis=1)
    return np.clip(0.4 + 1.3 * wave, 0.0, 1.0)


def _blink(
    shown: Float[Array, "F E"], left: int, right: int, times_s: Float[Array, "F"],
    rng: np.random.Generator,
) -> None:  # fmt: skip
    moment = times_s[0] + rng.uniform(0.0, _BLINKS_EVERY_S)
    while moment < times_s[-1]:
        closed = np.exp(-0.5 * ((times_s - moment) / _BLINK_S) ** 2)
        chance = rng.uniform()
        eyes = (left, right) if chance > _WINKS else (left,) if chance < 0.5 * _WINKS else (right,)
        for eye in eyes:
            shown[:, eye] = np.maximum(shown[:, eye], closed)
        moment += rng.uniform(0.5, 1.5) * _BLINKS_EVERY_S
