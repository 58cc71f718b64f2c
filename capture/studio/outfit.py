"""Clothes, skin and hair: a solid texture, evaluated at every sample of the rest surface.

Colours are sRGB albedo. Edges are hard on purpose: a blurry model loses seams, stripes,
letters and buttons. Everything is a function of the rest position (T-pose, m), the surface
normal and the joint that moves the place most.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import cv2
import numpy as np

from scene.arrays import Array, Bool, Float, Int
from scene.skeleton import JOINT_NAMES

_PRINT_HALF_M = 0.085
_PRINTS = ("NERF", "META", "VIEW", "SEEN", "HERE")


@dataclass(frozen=True, eq=False)
class Outfit:
    """One performer's clothes and colours."""

    shirt: Float[Array, "2 3"]
    """Ground and stripe."""
    trousers: Float[Array, "3"]
    shoes: Float[Array, "3"]
    skin: Float[Array, "3"]
    hair: Float[Array, "3"]
    stripe_m: float
    """Height of a stripe with its gap, m."""
    checked: bool
    long_sleeves: bool
    letters: Bool[Array, "P Q"]
    """The chest print, True where it is printed."""
    hair_drop_m: float
    """How far the hair hangs below a short cut at the sides and the nape."""
    uniform: bool = False
    """Shirt, trousers and shoes have one colour each."""


def make_outfit(rng: np.random.Generator) -> Outfit:
    """Clothes drawn from `rng`."""
    hue = rng.uniform()
    ground = _rgb(hue, rng.uniform(0.45, 0.75), rng.uniform(0.55, 0.9))
    stripe = _rgb(hue + rng.uniform(0.35, 0.65), rng.uniform(0.3, 0.8), rng.uniform(0.3, 0.95))
    tone = rng.uniform()
    skin = (1.0 - tone) * np.array([0.93, 0.76, 0.65]) + tone * np.array([0.45, 0.29, 0.21])
    canvas = np.zeros((64, 128), np.uint8)
    word = _PRINTS[int(rng.integers(len(_PRINTS)))]
    cv2.putText(canvas, word, (6, 47), cv2.FONT_HERSHEY_SIMPLEX, 1.5, 255, 6)
    return Outfit(
        shirt=np.stack([ground, stripe]),
        trousers=_rgb(rng.uniform(), rng.uniform(0.2, 0.6), rng.uniform(0.2, 0.5)),
        shoes=_rgb(rng.uniform(), 0.3, rng.uniform(0.15, 0.8)),
        skin=skin,
        hair=_rgb(rng.uniform(0.02, 0.12), 0.6, rng.uniform(0.08, 0.45)),
        stripe_m=float(rng.uniform(0.07, 0.11)),
        checked=bool(rng.uniform() < 0.5),
        long_sleeves=bool(rng.uniform() < 0.6),
        letters=canvas > 127,
        hair_drop_m=float(rng.choice([0.0, 0.035, 0.09])),
    )


def albedo(
    outfit: Outfit,
    rest: Float[Array, "N 3"],
    normal: Float[Array, "N 3"],
    joint: Int[Array, "N"],
    rest_joints: Float[Array, "24 3"],
    *,
    eyes: bool = True,
) -> Float[Array, "N 3"]:
    """Colour of every sample at rest position `rest`; with `eyes` painted on, or without."""
    at = {name: rest_joints[i] for i, name in enumerate(JOINT_NAMES)}
    height = rest[:, 1]
    head = np.isin(joint, [JOINT_NAMES.index("head"), JOINT_NAMES.index("neck")])
    # hips may be as wide as shoulders, so arms are also recognised by their height
    arms = (np.abs(rest[:, 0]) > 0.9 * at["left_shoulder"][0]) & (height > at["spine3"][1])
    waist = at["pelvis"][1] + 0.06
    cuff = at["left_wrist" if outfit.long_sleeves else "left_elbow"][0] - 0.02
    collar = _distance_below_collar(rest, at)
    is_shirt = (height > waist) & (np.abs(rest[:, 0]) < cuff) & (collar > 0.0)
    is_trousers = (height <= waist) & (height > at["left_ankle"][1] + 0.05)
    is_shoe = height <= at["left_ankle"][1] + 0.05
    colour = np.tile(outfit.skin, (len(rest), 1))
    colour[is_shirt], colour[is_trousers] = outfit.shirt[0], outfit.trousers
    colour[is_shoe] = outfit.shoes
    if not outfit.uniform:
        _paint_shirt(colour, is_shirt, outfit, rest, normal, arms, at)
        colour[is_shirt & (collar < 0.012)] = 0.7 * outfit.shirt[1]
        _paint_trousers(colour, is_trousers, outfit, rest, waist, at["left_knee"])
        _paint_shoes(colour, is_shoe, rest, normal, at["left_foot"])
    _paint_head(colour, head & ~is_shirt, outfit, rest, at, eyes)
    # ambient occlusion of downward normals, which shapes chin, nose and fingers
    bare = ~(is_shirt | is_trousers | is_shoe)
    colour[bare] *= 1.0 - 0.2 * np.maximum(-normal[bare, 1:2], 0.0)
    return colour.astype(np.float32)


def cloth_albedo(
    outfit: Outfit, texture: Float[Array, "N 2"], inside: Bool[Array, "N"]
) -> Float[Array, "N 3"]:
    """Colour of loose cloth at `texture` (m around, m above the hem); darker on its inside."""
    around, above_hem = texture.T
    colour = np.tile(outfit.shirt[0], (len(texture), 1))
    colour[np.mod(around, outfit.stripe_m) < 0.42 * outfit.stripe_m] = outfit.shirt[1]
    cell = np.mod(texture + 0.02, 0.08) - 0.04
    colour[np.hypot(cell[:, 0], cell[:, 1]) < 0.012] = [0.95, 0.93, 0.86]
    colour[above_hem < 0.03] = 0.6 * outfit.shirt[1]
    colour[(above_hem > 0.036) & (above_hem < 0.042)] = [0.9, 0.85, 0.6]
    colour[inside] *= 0.5
    return colour.astype(np.float32)


def _rgb(hue: float, saturation: float, value: float) -> Float[Array, "3"]:
    return np.array(colorsys.hsv_to_rgb(hue % 1.0, saturation, value))


def _distance_below_collar(rest: Array, at: dict[str, Array]) -> Array:
    """Distance, m, outside a round neck opening that slopes down at the front."""
    edge = at["neck"][1] - 0.02 - 0.35 * np.maximum(rest[:, 2], 0.0)
    from_neck = np.hypot(rest[:, 0], rest[:, 2] - at["neck"][2])
    chin = np.maximum(rest[:, 1] - at["neck"][1] - 0.01, 0.0)  # the head is wider than the opening
    return np.maximum(edge - rest[:, 1], from_neck - 0.09 - 4.0 * chin)


def _paint_shirt(
    colour: Array,
    where: Array,
    outfit: Outfit,
    rest: Array,
    normal: Array,
    arms: Array,
    at: dict[str, Array],
) -> None:
    along = np.where(arms, np.abs(rest[:, 0]), rest[:, 1])
    striped = np.mod(along, outfit.stripe_m) < 0.42 * outfit.stripe_m
    colour[where] = outfit.shirt[0]
    colour[where & striped] = outfit.shirt[1]
    if outfit.checked:
        across = np.where(arms, rest[:, 1], rest[:, 0])
        columns = np.mod(across, outfit.stripe_m) < 0.42 * outfit.stripe_m
        colour[where & columns] = 0.5 * (outfit.shirt[0] + outfit.shirt[1])
        colour[where & columns & striped] = 0.6 * outfit.shirt[1]
    seam = np.abs(np.abs(rest[:, 0]) - at["left_shoulder"][0]) < 0.004
    side = ~arms & (np.abs(rest[:, 2] - at["spine2"][2]) < 0.004)
    colour[where & (seam | side)] *= 0.45
    _paint_print(colour, where & (normal[:, 2] > 0.2), outfit, rest, at)
    buttons = (np.abs(rest[:, 0]) < 0.009) & (np.mod(rest[:, 1], 0.09) < 0.018)
    below = rest[:, 1] < at["spine3"][1] + 0.02
    colour[where & buttons & below & (normal[:, 2] > 0.2)] = [0.97, 0.95, 0.88]


def _paint_print(colour: Array, front: Array, outfit: Outfit, rest: Array, at: dict) -> None:
    rows, columns = outfit.letters.shape
    centre = 0.5 * (at["spine3"][1] + at["neck"][1]) - 0.02
    u = (rest[:, 0] / _PRINT_HALF_M + 1.0) * 0.5  # the viewer in front sees +x on the right
    v = (centre - rest[:, 1]) / _PRINT_HALF_M + 0.5
    panel = front & (u > -0.08) & (u < 1.08) & (v > -0.06) & (v < 1.06)
    colour[panel] = [0.96, 0.95, 0.92]
    inside = panel & (u > 0) & (u < 1) & (v > 0) & (v < 1)
    ink = outfit.letters[
        np.clip((v[inside] * rows).astype(int), 0, rows - 1),
        np.clip((u[inside] * columns).astype(int), 0, columns - 1),
    ]
    colour[np.flatnonzero(inside)[ink]] = [0.1, 0.1, 0.16]


def _paint_trousers(
    colour: Array, where: Array, outfit: Outfit, rest: Array, waist: float, knee: Array
) -> None:
    height = rest[:, 1]
    colour[where] = outfit.trousers
    weave = np.mod(height * 3.0 + np.abs(rest[:, 0]) * 5.0, 0.05) < 0.012
    colour[where & weave] = 1.18 * outfit.trousers
    seam = (np.abs(rest[:, 2] + 0.008) < 0.004) & (np.abs(rest[:, 0]) > 0.1)
    pocket = (np.abs(height - (waist - 0.13) - 1.2 * (np.abs(rest[:, 0]) - 0.12)) < 0.004) & (
        rest[:, 2] > 0.02
    )
    colour[where & (seam | (pocket & (height > waist - 0.17)))] = 1.9 * outfit.trousers + 0.1
    patch = (np.abs(height - knee[1]) < 0.05) & (np.abs(rest[:, 0] - knee[0]) < 0.04)
    colour[where & patch & (rest[:, 2] > knee[2])] = [0.75, 0.62, 0.4]
    belt = height > waist - 0.035
    colour[where & belt] = [0.22, 0.14, 0.09]
    colour[where & belt & (np.abs(rest[:, 0]) < 0.025) & (rest[:, 2] > 0)] = [0.85, 0.78, 0.5]


def _paint_shoes(colour: Array, where: Array, rest: Array, normal: Array, foot: Array) -> None:
    height = rest[:, 1]
    toe_cap = rest[:, 2] > foot[2] + 0.005
    colour[where & ((height < 0.025) | toe_cap)] = [0.92, 0.92, 0.9]
    instep = (np.abs(np.abs(rest[:, 0]) - foot[0]) < 0.025) & (normal[:, 1] > 0.3)
    colour[where & instep & ~toe_cap & (np.mod(height, 0.02) < 0.007)] = [0.95, 0.95, 0.95]


def _paint_head(
    colour: Array, head: Array, outfit: Outfit, rest: Array, at: dict, eyes: bool
) -> None:
    x, y, z = np.abs(rest[:, 0]), rest[:, 1] - at["head"][1], rest[:, 2] - at["head"][2]
    front = head & (z > 0.02)
    if eyes:
        colour[front & (((x - 0.031) / 0.016) ** 2 + ((y - 0.047) / 0.008) ** 2 < 1.0)] = 0.97
        colour[front & ((x - 0.031) ** 2 + (y - 0.047) ** 2 < 0.0075**2)] = [0.16, 0.24, 0.3]
    arch = np.abs(y - 0.067 + 12.0 * (x - 0.03) ** 2)
    taper = 0.005 - 0.12 * np.maximum(x - 0.03, 0.0)  # thinner towards the temple
    colour[front & (np.abs(x - 0.033) < 0.019) & (arch < taper)] = 0.8 * outfit.hair
    colour[front & ((x / 0.024) ** 2 + ((y + 0.028) / 0.007) ** 2 < 1.0)] = [0.68, 0.3, 0.3]
    # from the forehead down to the nape
    back = np.clip(0.035 - z, 0.0, 0.13)
    hairline = 0.09 - back - outfit.hair_drop_m * np.clip(back / 0.04, 0.0, 1.0)
    strands = 0.006 * np.sin(900.0 * np.arctan2(rest[:, 0], z + 1e-9) / np.pi)
    hair = head & (y > hairline + strands)
    shine = 1.0 + 0.22 * np.sin(95.0 * np.arctan2(rest[:, 0], z + 1e-9))
    colour[hair] = np.clip(outfit.hair * shine[hair, None], 0.0, 1.0)
