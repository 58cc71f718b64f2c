"""Loose clothes: they hang, lag and swing as no skinning can, and leave the body alone."""

from __future__ import annotations

import numpy as np
import pytest

from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.garments import Drape, drape
from capture.studio.motions import gesture_motion, turntable_motion, with_turn
from capture.studio.performer import StudioPerformer, make_performer
from scene import Motion
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE

PERFORMER = make_performer(0)
SKIRT = PERFORMER.garments[0]


def hems(performer: StudioPerformer, motion: Motion, hung: Drape) -> list[np.ndarray]:
    """Where each garment's last ring is, a frame [F A 3], in the frame of the joint it is sewn to.

    Skinning would leave it where it rests.
    """
    moved = performer.body.skeleton.skinning_transforms(
        motion.joint_angles, motion.root_translation
    )
    world = np.stack([hung.at(float(time)) for time in motion.times_s])
    found, first = [], 0
    for garment in performer.garments:
        rings, sides = garment.rest.shape[:2]
        hem = world[:, first + (rings - 1) * sides : first + rings * sides]
        joint = moved[:, garment.joint]
        found.append((hem - joint[:, None, :3, 3]) @ joint[:, :3, :3])
        first += rings * sides
    return found


def wear(motion: Motion) -> tuple[Drape, list[np.ndarray]]:
    hung = drape(PERFORMER.garments, PERFORMER.body, motion)
    return hung, hems(PERFORMER, motion, hung)


def standing(seconds: float) -> Motion:
    frames = round(10.0 * seconds)
    still = turntable_motion(1, 10.0, 0.0)
    return Motion(
        np.arange(frames) / 10.0,
        np.repeat(still.joint_angles, frames, axis=0),
        np.zeros((frames, 3)),
        np.ones((frames, 24)),
    )


@pytest.mark.parametrize(
    ("motion", "spread_m"),
    [
        (turntable_motion(60, 10.0, 360.0), (0.008, 0.02, 0.02)),
        (gesture_motion(60, 10.0), (0.02, 0.05, 0.05)),
    ],
    ids=["slow", "lively"],
)
def test_clothes_swing_by_centimetres_beyond_skinning(motion, spread_m):
    """Beyond any skinning to their joint: the spread about their own mean place in its frame."""
    _, found = wear(motion)
    for hem, least in zip(found, spread_m, strict=True):
        swing = np.linalg.norm(hem - hem.mean(axis=0), axis=-1)
        assert np.sqrt((swing**2).mean()) > least
        assert 0.03 < swing.max() < 0.4  # and no further than cloth can


def test_clothes_of_who_stands_still_hang_still():
    _, found = wear(standing(3.0))
    for hem in found:
        assert np.ptp(hem[15:], axis=0).max() < 0.005


def test_sleeves_hang_down_from_raised_arms():
    raised = standing(2.0)
    angles = raised.joint_angles.copy()
    angles[:, 1:] = 0.0  # the T-pose
    hung, _ = wear(Motion(raised.times_s, angles, raised.root_translation, raised.confidence))
    sleeve = PERFORMER.garments[1]
    first, sides = SKIRT.rest[..., 0].size, sleeve.rest.shape[1]
    hem = hung.at(1.0)[first : first + sleeve.rest[..., 0].size][-sides:]
    assert (hem[:, 1] - sleeve.rest[-1, :, 1]).mean() < -0.02


def test_a_fast_turn_lifts_the_skirt():
    still = standing(2.0)
    _, slow = wear(still)
    _, fast = wear(with_turn(still, 4.0 * 360.0))
    width = [np.linalg.norm(hem[0][10:, :, [0, 2]], axis=-1).mean() for hem in (slow, fast)]
    assert width[1] > width[0] + 0.03


def test_threads_keep_their_length_and_their_seam():
    motion = gesture_motion(40, 10.0)
    hung, _ = wear(motion)
    rings, sides = SKIRT.rest.shape[:2]
    skirt = hung.vertices[:, : rings * sides].reshape(-1, rings, sides, 3)
    length = np.linalg.norm(np.diff(skirt, axis=1), axis=-1)
    rest = np.linalg.norm(np.diff(SKIRT.rest, axis=0), axis=-1)
    assert np.median(np.abs(length / rest - 1.0)) < 0.03  # limbs may stretch them here and there
    np.testing.assert_allclose(skirt[:, :, 0], skirt[:, :, -1], atol=1e-9)


def test_legs_stay_inside_the_skirt():
    motion = gesture_motion(40, 10.0)
    hung, _ = wear(motion)
    joints = PERFORMER.body.skeleton.joint_transforms(motion.joint_angles, motion.root_translation)[
        ..., :3, 3
    ]
    for index, time in enumerate(motion.times_s):
        skirt = hung.at(float(time))[: SKIRT.rest[..., 0].size][SKIRT.rest.shape[1] :]
        for start, end, radius in SKIRT.limbs:
            a, bone = joints[index, start], joints[index, end] - joints[index, start]
            along = np.clip((skirt - a) @ bone / (bone @ bone), 0.0, 1.0)
            assert np.linalg.norm(skirt - a - along[:, None] * bone, axis=1).min() > 0.7 * radius


@pytest.mark.parametrize("seed", range(4))
def test_clothes_lie_outside_the_body_at_rest(seed):
    performer = make_performer(seed)
    skirt = performer.garments[0].rest
    vertices = performer.body.rest_vertices
    assert vertices is not None
    for ring in skirt:
        slice_ = vertices[np.abs(vertices[:, 1] - ring[0, 1]) < 0.02][:, [0, 2]]
        outward = ring[:-1, [0, 2]] / np.linalg.norm(ring[:-1, [0, 2]], axis=1, keepdims=True)
        reach = (ring[:-1, [0, 2]] * outward).sum(axis=1)
        assert (reach > (slice_ @ outward.T).max(axis=0)).all()


def test_loose_adds_cloth_and_changes_nothing_else(tmp_path):
    for look in ("plain", "loose"):
        make_sequence(tmp_path / look, look=look, frames=4, size=96, test_cameras=2, seed=3)
    for name in ("body.npz", "motion.npz", "cameras.npz"):
        plain, loose = ((np.load(tmp_path / look / name)) for look in ("plain", "loose"))
        for key in plain:
            np.testing.assert_array_equal(plain[key], loose[key])
    plain, loose = (open_sequence(tmp_path / look) for look in ("plain", "loose"))
    for a, b in (
        (plain.train, loose.train),
        *((plain.test[s], loose.test[s]) for s in (NOVEL_VIEW, UNSEEN_POSE)),
    ):
        changed = np.stack([np.abs(a.image(i) - b.image(i)).max(axis=-1) > 0.0 for i in range(4)])
        masks = np.stack([b.mask(i) - a.mask(i) for i in range(4)])
        assert masks.min() >= 0.0  # cloth hides, it never uncovers
        assert (masks > 0.5).any()
        body = np.stack([b.mask(i) > 0.0 for i in range(4)])
        assert 0.1 < changed[body].mean() < 0.6  # head, hands and shins are as they were


def test_the_same_motion_drapes_the_same_way():
    motion = turntable_motion(10, 10.0, 90.0)
    first, again = (drape(PERFORMER.garments, PERFORMER.body, motion) for _ in range(2))
    np.testing.assert_array_equal(first.vertices, again.vertices)
