"""Head and palms: where their landmarks were seen, and how they were turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from capture.detection.rigid_parts import PART_JOINTS, PARTS, rest_points
from capture.fitting.kinematics import rotation_matrices
from capture.fitting.observations import Observations, PartObservations
from capture.fitting.state import PosedClip
from capture.fitting.terms.part_poses import DEVIATION, DEVIATION_RAD, PartPoses
from tests.capture.fitting.known_clips import (
    FRAMES,
    PERSON_PX,
    assert_gradients_are_slopes,
    disturbed,
    double_precision,
    energy_of,
    known_body,
    known_state,
    seen_of,
)

STATE = known_state()
LEFT = PARTS.index("left_wrist")


def seen_parts(off_px: float = 0.0, turned_rad: float = 0.0) -> Observations:
    """All parts as they are, but for a left palm that is seen elsewhere."""
    seen = seen_of(STATE)
    with double_precision():
        posed = PosedClip(STATE, known_body(), seen).posed
        joints = list(PART_JOINTS)
        rotations = posed.global_rotations[:, joints].clone()
        middles = torch.tensor(np.array([rest_points(part).mean(axis=0) for part in PARTS]))
        at = posed.joint_positions[:, joints] + (rotations @ middles[..., None])[..., 0]
        pixels = PosedClip(STATE, known_body(), seen).project(at)
        pixels[:, LEFT, 0] += off_px
        rotations[:, LEFT] @= rotation_matrices(torch.tensor([[0.0, turned_rad, 0.0]]))
        every = torch.ones(FRAMES, len(PARTS))
        return replace(seen, parts=PartObservations(pixels, rotations, every, every.clone()))


def test_parts_as_they_were_seen_cost_nothing():
    assert energy_of(PartPoses, STATE, seen_parts()) == pytest.approx(0.0, abs=1e-9)


def test_a_clip_whose_parts_nobody_looked_at_costs_nothing():
    assert energy_of(PartPoses, STATE, seen_of(STATE)) == 0.0


def test_a_deviation_costs_about_one_and_an_outlier_little_more():
    px, rad = DEVIATION * PERSON_PX, DEVIATION_RAD[LEFT]
    assert energy_of(PartPoses, STATE, seen_parts(off_px=px)) == pytest.approx(1.0, abs=0.07)
    assert energy_of(PartPoses, STATE, seen_parts(turned_rad=rad)) == pytest.approx(1.0, abs=0.08)
    far = [energy_of(PartPoses, STATE, seen_parts(off_px=n * px)) for n in (60.0, 120.0)]
    assert far[1] - far[0] < 0.1


def test_what_was_not_found_or_not_believed_has_no_say():
    seen = seen_parts(off_px=30.0, turned_rad=0.5)
    assert seen.parts is not None
    seen.parts.turned[:, LEFT] = 0.0
    moved = energy_of(PartPoses, STATE, seen)
    assert moved == pytest.approx(energy_of(PartPoses, STATE, seen_parts(off_px=30.0)))
    seen.parts.found[:, LEFT] = 0.0
    assert energy_of(PartPoses, STATE, seen) == pytest.approx(0.0, abs=1e-9)


def test_gradients_are_slopes():
    assert_gradients_are_slopes(PartPoses, disturbed(STATE), seen_parts())
