"""What a forearm hides from the camera, and what the body does."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.splats.layout import ALPHA, EMPTY_BOX, MEAN_X, MEAN_Y
from renderer.splats.rasteriser.workspace import Workspace
from renderer.splats.training.occlusion import hidden_by_body, hidden_by_limbs, limb_splats
from scene.arrays import Array, Bool
from scene.skeleton import JOINT_NAMES

SIZE, FOCAL_PX = (100, 100), 500.0


def arranged(rows: list[tuple[float, float, float]]) -> Workspace:
    """Opaque splats at (x px, y px, depth m)."""
    work = Workspace(len(rows))
    work.projected[:, ALPHA] = 0.9
    for place, (x, y, depth_m) in enumerate(rows):
        work.projected[place, [MEAN_X, MEAN_Y]], work.depth[place] = (x, y), depth_m
    return work


def hidden(work: Workspace, limbs: int = 1) -> list[bool]:
    """Of a workspace whose first splats are of limbs."""
    mask: Bool[Array, "N"] = np.arange(len(work.depth)) < limbs
    return hidden_by_limbs(work, mask, SIZE, FOCAL_PX).tolist()


def test_what_lies_behind_a_hand_is_hidden_and_what_lies_beside_is_not():
    work = arranged([(50, 50, 1.0), (50, 50, 1.3), (80, 50, 1.3), (50, 50, 0.9)])
    assert hidden(work) == [False, True, False, False]


def test_a_hand_hides_a_little_more_than_it_covers():
    """Its pose may be off; 1.5 cm are 7.5 px here."""
    work = arranged([(50, 50, 1.0), (56, 50, 1.3), (50, 44, 1.3), (66, 50, 1.3)])
    assert hidden(work) == [False, True, True, False]


def test_a_sleeve_close_behind_the_wrist_and_other_limbs_are_not_hidden():
    work = arranged([(50, 50, 1.0), (50, 50, 1.3), (50, 50, 1.02)])
    assert hidden(work, limbs=2) == [False, False, False]


def test_a_hand_that_is_not_drawn_or_seen_through_hides_nothing():
    work = arranged([(50, 50, 1.0), (50, 50, 1.3)])
    work.projected[0, ALPHA] = 0.1
    assert hidden(work) == [False, False]
    work.projected[0, ALPHA] = 0.9
    work.boxes[0, 0] = EMPTY_BOX
    assert hidden(work) == [False, False]


def test_the_far_side_of_the_body_is_hidden_and_folds_of_the_near_side_are_not():
    work = arranged([(50, 50, 1.0), (50, 50, 1.22), (50, 50, 1.1), (80, 50, 1.22)])
    nothing, hand = np.zeros(4, bool), np.array([True, False, False, False])
    assert hidden_by_body(work, nothing, SIZE).tolist() == [False, True, False, False]
    assert hidden_by_body(work, hand, SIZE).tolist() == [False, False, False, False]
    work.projected[[0, 2], ALPHA] = 0.1
    assert not hidden_by_body(work, nothing, SIZE).any(), "what is seen through hides nothing"


@pytest.mark.parametrize(
    ("joint", "limb"),
    [("left_elbow", True), ("right_hand", True), ("left_wrist", True), ("left_shoulder", False)],
)
def test_limbs_are_forearms_and_hands(joint: str, limb: bool):
    joints = np.array([[JOINT_NAMES.index("spine3"), JOINT_NAMES.index(joint), 0, 0]])
    assert limb_splats(joints, np.array([[0.3, 0.7, 0.0, 0.0]])).tolist() == [limb]
