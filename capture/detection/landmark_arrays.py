"""The landmarks of a clip as arrays: how far each is believed, what is missing, and what they show.

Visibility is the estimator's own; weights are what the fits make of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from capture.body.landmark_names import FACE_LANDMARKS, LANDMARK_NAMES
from capture.detection.landmarks import Landmarks
from scene.arrays import Array, Float, Int
from scene.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS

LONGEST_GAP_S = 0.6
"""How long a landmark may be missing to be interpolated."""
_SHOWN_BY = {"shoulder": "elbow", "elbow": "wrist", "wrist": "index", "hip": "knee",
             "knee": "ankle", "ankle": "foot_index"}  # fmt: skip
"""The landmark beyond a joint, which shows how the joint moves."""
_LANDMARK_OF_JOINT = {"shoulder": "shoulder", "elbow": "elbow", "wrist": "wrist", "hand": "index",
                      "hip": "hip", "knee": "knee", "ankle": "ankle", "foot": "foot_index",
                      "collar": "shoulder"}  # fmt: skip
_STIFF_SPINE = 0.15
"""How far the spine counts as hidden without legs, whose pelvis could tilt unseen."""
_NEARLY_ALWAYS = 0.85
"""Share of a clip's frames."""

_J = {name: index for index, name in enumerate(JOINT_NAMES)}


def landmark_arrays(
    people: Sequence[Landmarks], width: int, height: int
) -> tuple[Array, Array, Array]:
    """Pixels [F 33 2], world [F 33 3] and trust [F 33] of all frames; no trust outside."""
    pixels = np.zeros((len(people), len(LANDMARK_NAMES), 2))
    world = np.zeros((len(people), len(LANDMARK_NAMES), 3))
    trust = np.zeros((len(people), len(LANDMARK_NAMES)))
    for frame, person in enumerate(people):
        pixels[frame], world[frame] = person.pixels, person.world
        inside = (person.pixels >= 0).all(1) & (person.pixels <= [width, height]).all(1)
        trust[frame] = np.where(inside, person.visibility, 0.0) ** 2
    trust[trust < 0.1] = 0.0
    trust[:, 1:FACE_LANDMARKS] *= 0.35  # ten points of one rigid face must not outvote the limbs
    return pixels, world, trust


def interpolate_gaps(
    people: Sequence[Landmarks],
    times_s: Float[Array, "F"],
    takes: Int[Array, "F"],
    longest_gap_s: float = LONGEST_GAP_S,
) -> tuple[Array, Array, Array]:
    """Pixels [F 33 2], world [F 33 3] and visibility [F 33], with landmarks that are missing for
    moments put on the line between where they were and where they come back in the same take.

    A network that never missed one makes much of it. Missing is what has no visibility at all; a
    guess at what is hidden, which has some, tells more than its neighbours.
    """
    whole = np.stack([
        np.concatenate([p.pixels, p.world, p.visibility[:, None]], axis=1) for p in people
    ])  # fmt: skip
    visibility = whole[..., -1].copy()
    for landmark in range(len(LANDMARK_NAMES)):
        seen = np.flatnonzero(visibility[:, landmark] > 0.0)
        for before, after in pairwise(seen):
            gap_s = times_s[after] - times_s[before]
            if takes[before] != takes[after] or gap_s > longest_gap_s:
                continue
            inside = slice(before + 1, after)
            share = ((times_s[inside] - times_s[before]) / gap_s)[:, None]
            ends = whole[before, landmark], whole[after, landmark]
            whole[inside, landmark] = (1.0 - share) * ends[0] + share * ends[1]
    return whole[..., :2], whole[..., 2:5], whole[..., 5]


def joint_confidence(weights: Float[Array, "F 33"]) -> Float[Array, "F 24"]:
    """Trust in each joint, from that in the landmarks that show it."""
    shown = np.sqrt(np.clip(weights, 0.0, 1.0))
    at = {name: index for index, name in enumerate(LANDMARK_NAMES)}
    trunk = shown[:, [at["left_shoulder"], at["right_shoulder"]]].mean(axis=1)
    hips = shown[:, [at["left_hip"], at["right_hip"]]].mean(axis=1)
    confidence = np.zeros((len(weights), JOINT_COUNT))
    for name, joint in _J.items():
        side, _, part = name.partition("_")
        if part:
            confidence[:, joint] = shown[:, at[f"{side}_{_LANDMARK_OF_JOINT[part]}"]]
        elif name == "pelvis":
            confidence[:, joint] = hips
        else:
            confidence[:, joint] = shown[:, at["nose"]] if name in ("head", "neck") else trunk
    return confidence


def hidden_joints(trust: Float[Array, "F 33"]) -> Float[Array, "F 24"]:
    """1 for each limb joint whose motion nothing shows: the landmark beyond it is not seen."""
    hidden = np.zeros((len(trust), JOINT_COUNT))
    for joint, landmark in _SHOWN_BY.items():
        for side in ("left", "right"):
            unseen = trust[:, LANDMARK_NAMES.index(f"{side}_{landmark}")] <= 0.0
            hidden[:, JOINT_NAMES.index(f"{side}_{joint}")] = unseen
    knees = [LANDMARK_NAMES.index("left_knee"), LANDMARK_NAMES.index("right_knee")]
    no_legs = (trust[:, knees] <= 0.0).all(axis=1)
    for joint in ("spine1", "spine2", "spine3"):
        hidden[:, JOINT_NAMES.index(joint)] = _STIFF_SPINE * no_legs
    return hidden


def always_hidden(hidden: Float[Array, "F 24"]) -> Float[Array, "24"]:
    """How far each joint counts as hidden in the whole clip: as a mean, where nearly always.

    What is out of sight for a while goes on as its neighbours in time and the network's guess have
    it; what never shows stays at rest.
    """
    return hidden.mean(axis=0) * ((hidden > 0.0).mean(axis=0) > _NEARLY_ALWAYS)


def hidden_subtrees(hidden: Float[Array, "F 24"]) -> Float[Array, "F 24"]:
    """1 for joints that are hidden themselves or hang on one that is."""
    beyond = (hidden >= 1.0).astype(float)
    for joint in range(1, JOINT_COUNT):
        beyond[:, joint] = np.maximum(beyond[:, joint], beyond[:, PARENTS[joint]])
    return beyond


def person_height_px(pixels: Float[Array, "F 33 2"]) -> float:
    """About the standing person's height in px, from the trunk's length (robust over the clip)."""
    left, right = LANDMARK_NAMES.index("left_shoulder"), LANDMARK_NAMES.index("right_shoulder")
    hips = [LANDMARK_NAMES.index(n) for n in ("left_hip", "right_hip")]
    shoulders = 0.5 * (pixels[:, left] + pixels[:, right])
    trunk = np.linalg.norm(shoulders - pixels[:, hips].mean(1), axis=1)
    return height_from_trunk_px(float(np.percentile(trunk, 75)))


def height_from_trunk_px(trunk_px: float) -> float:
    """About the standing person's height in px, whose trunk is so long."""
    return max(3.4 * trunk_px, 20.0)
