"""The landmarks of a clip as arrays: weights, gaps, and which joints they determine.

Visibility is the estimator's; weights are derived from it for the fits.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from capture.body.landmark_names import FACE_LANDMARKS, LANDMARK_NAMES
from capture.detection.landmarks import Landmarks
from scene.arrays import Array, Bool, Float, Int
from scene.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS

LONGEST_GAP_S = 0.6
"""How long a landmark may be missing to be interpolated."""
_DISTAL_LANDMARK = {
    "shoulder": "elbow",
    "elbow": "wrist",
    "wrist": "index",
    "hip": "knee",
    "knee": "ankle",
    "ankle": "foot_index",
}
"""The landmark beyond a joint, which determines its rotation."""
_LANDMARK_OF_JOINT = {
    "shoulder": "shoulder",
    "elbow": "elbow",
    "wrist": "wrist",
    "hand": "index",
    "hip": "hip",
    "knee": "knee",
    "ankle": "ankle",
    "foot": "foot_index",
    "collar": "shoulder",
}
_SIZE_ABOUT_S = 2.0
"""On each side of a frame, for which the person's size is taken together."""
_ABOUT_AS_LARGE = 1.5
"""Times as large: pixels' errors hardly grow with a person who is somewhat larger (a walk in an
eight, by each frame's own size, is 1.6 mm worse)."""
_SPINE_HIDDEN = 0.15
"""How far the spine counts as hidden where no leg shows the pelvis' tilt."""
_ABOUT_S, _ALWAYS_SHARE = 1.0, 0.85
"""On each side of a frame, and the share of the frames within that."""

_J = {name: index for index, name in enumerate(JOINT_NAMES)}
_BELOW = [
    index
    for name, index in _J.items()
    if name.endswith(("hip", "knee", "ankle", "foot")) or name.startswith("spine")
]


def landmark_arrays(
    people: Sequence[Landmarks], width: int, height: int
) -> tuple[Array, Array, Array]:
    """Pixels [F 33 2], world [F 33 3] and weights [F 33] of all frames; no weight outside."""
    pixels = np.zeros((len(people), len(LANDMARK_NAMES), 2))
    world = np.zeros((len(people), len(LANDMARK_NAMES), 3))
    weights = np.zeros((len(people), len(LANDMARK_NAMES)))
    for frame, person in enumerate(people):
        pixels[frame], world[frame] = person.pixels, person.world
        inside = (person.pixels >= 0).all(1) & (person.pixels <= [width, height]).all(1)
        weights[frame] = np.where(inside, person.visibility, 0.0) ** 2
    weights[weights < 0.1] = 0.0
    weights[:, 1:FACE_LANDMARKS] *= 0.35  # ten points of one rigid face must not outweigh the limbs
    return pixels, world, weights


def interpolate_gaps(
    people: Sequence[Landmarks],
    times_s: Float[Array, "F"],
    takes: Int[Array, "F"],
    longest_gap_s: float = LONGEST_GAP_S,
) -> tuple[Array, Array, Array]:
    """Pixels [F 33 2], world [F 33 3] and visibility [F 33], with landmarks that are briefly
    missing interpolated linearly within a take.

    The lifter is trained without missing landmarks. Missing means zero visibility; a guess at a
    hidden landmark has some, and is better than interpolation.
    """
    stacked = np.stack(
        [np.concatenate([p.pixels, p.world, p.visibility[:, None]], axis=1) for p in people]
    )
    visibility = stacked[..., -1].copy()
    for landmark in range(len(LANDMARK_NAMES)):
        seen = np.flatnonzero(visibility[:, landmark] > 0.0)
        for before, after in pairwise(seen):
            gap_s = times_s[after] - times_s[before]
            if takes[before] != takes[after] or gap_s > longest_gap_s:
                continue
            inside = slice(before + 1, after)
            share = ((times_s[inside] - times_s[before]) / gap_s)[:, None]
            ends = stacked[before, landmark], stacked[after, landmark]
            stacked[inside, landmark] = (1.0 - share) * ends[0] + share * ends[1]
    return stacked[..., :2], stacked[..., 2:5], stacked[..., 5]


def joint_confidence(weights: Float[Array, "F 33"]) -> Float[Array, "F 24"]:
    """Confidence of each joint, from the weights of the landmarks that determine it."""
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


def hidden_joints(weights: Float[Array, "F 33"]) -> Float[Array, "F 24"]:
    """1 for each limb joint without evidence: the landmark beyond it is not visible."""
    hidden = np.zeros((len(weights), JOINT_COUNT))
    for joint, landmark in _DISTAL_LANDMARK.items():
        for side in ("left", "right"):
            unseen = weights[:, LANDMARK_NAMES.index(f"{side}_{landmark}")] <= 0.0
            hidden[:, JOINT_NAMES.index(f"{side}_{joint}")] = unseen
    knees = [LANDMARK_NAMES.index("left_knee"), LANDMARK_NAMES.index("right_knee")]
    no_legs = (weights[:, knees] <= 0.0).all(axis=1)
    for joint in ("spine1", "spine2", "spine3"):
        hidden[:, JOINT_NAMES.index(joint)] = _SPINE_HIDDEN * no_legs
    return hidden


def hidden_for_long(
    hidden: Float[Array, "F 24"], times_s: Float[Array, "F"], takes: Int[Array, "F"]
) -> Float[Array, "F 24"]:
    """How far each joint counts as hidden: as a mean, where nearly always; arms in the whole clip,
    trunk and legs for a second about.

    Joints hidden for a while follow their neighbours in time and the lifter. Arms that are below
    the picture are guessed well by it, legs not: it has people squat who are filmed close by.
    """
    lasting = _nearly_always(hidden) * np.ones((len(hidden), 1))
    for frame, about in enumerate(_frames_about(times_s, takes, _ABOUT_S)):
        lasting[frame, _BELOW] = _nearly_always(hidden[about][:, _BELOW])
    return lasting


def _frames_about(
    times_s: Float[Array, "F"], takes: Int[Array, "F"], within_s: float
) -> Bool[Array, "F F"]:
    """Of each frame: which of its take are within so long of it."""
    same_take = takes[:, None] == takes
    return same_take & (np.abs(times_s[:, None] - times_s) <= within_s)


def _nearly_always(hidden: Float[Array, "F J"]) -> Float[Array, "J"]:
    return hidden.mean(axis=0) * ((hidden > 0.0).mean(axis=0) > _ALWAYS_SHARE)


def hidden_subtrees(hidden: Float[Array, "F 24"]) -> Float[Array, "F 24"]:
    """1 for joints that are hidden or descend from a hidden one."""
    subtree = (hidden >= 1.0).astype(float)
    for joint in range(1, JOINT_COUNT):
        subtree[:, joint] = np.maximum(subtree[:, joint], subtree[:, PARENTS[joint]])
    return subtree


def person_height_px(
    pixels: Float[Array, "F 33 2"], times_s: Float[Array, "F"], takes: Int[Array, "F"]
) -> Float[Array, "F"]:
    """About the standing person's height in px, by how long the trunk is in most frames.

    One height for the clip, but where for seconds about it is another: people come close and step
    back.
    """
    left, right = LANDMARK_NAMES.index("left_shoulder"), LANDMARK_NAMES.index("right_shoulder")
    hips = [LANDMARK_NAMES.index(n) for n in ("left_hip", "right_hip")]
    shoulders = 0.5 * (pixels[:, left] + pixels[:, right])
    trunk = np.linalg.norm(shoulders - pixels[:, hips].mean(1), axis=1)
    around = _frames_about(times_s, takes, _SIZE_ABOUT_S)
    own = np.array([np.percentile(trunk[about], 75) for about in around])
    usual = np.percentile(trunk, 75)
    alike = (own < _ABOUT_AS_LARGE * usual) & (usual < _ABOUT_AS_LARGE * own)
    lengths = np.where(alike, usual, own)
    return np.array([height_from_trunk_px(float(length)) for length in lengths])


def height_from_trunk_px(trunk_px: float) -> float:
    """About the standing person's height in px, by the trunk's length."""
    return max(3.4 * trunk_px, 20.0)
