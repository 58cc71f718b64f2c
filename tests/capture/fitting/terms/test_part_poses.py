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
from capture.fitting.terms.part_poses import DEVIATION, DEVIATION_RAD, PALM_WEIGHT, PartPoses
from scene.arrays import Float, Tensor
from tests.capture.fitting.known_clips import (
    FRAMES,
    PERSON_PX,
    assert_gradients_are_slopes,
    disturbed,
    double_precision,
    energy_of,
    gradients_of,
    known_body,
    known_state,
    seen_of,
)

STATE = known_state()
LEFT = PARTS.index("left_wrist")


def seen_parts(
    off_px: float = 0.0, turned_rad: float = 0.0, pointing_rad: float = 0.0
) -> Observations:
    """All parts as they are, but for a left palm that is seen elsewhere, or points elsewhere
    there."""
    seen = seen_of(STATE)
    with double_precision():
        posed = PosedClip(STATE, known_body(), seen).posed
        joints = list(PART_JOINTS)
        rotations = posed.global_rotations[:, joints].clone()
        middles = torch.tensor(np.array([rest_points(part).mean(axis=0) for part in PARTS]))
        at = posed.joint_positions[:, joints] + (rotations @ middles[..., None])[..., 0]
        pixels = PosedClip(STATE, known_body(), seen).project(at)
        pixels[:, LEFT, 0] += off_px
        rest = torch.tensor(np.array([rest_points(part) for part in PARTS[1:]]))
        placed = posed.joint_positions[:, joints[1:], None] + torch.einsum(
            "fkxy,kpy->fkpx", rotations[:, 1:], rest
        )
        palms = PosedClip(STATE, known_body(), seen).project(placed.flatten(1, 2))
        palms = palms.unflatten(1, placed.shape[1:3])
        palms[:, LEFT - 1, :, 0] += off_px
        palms[:, LEFT - 1] = turned_in_picture(palms[:, LEFT - 1], pointing_rad)
        rotations[:, LEFT] @= rotation_matrices(torch.tensor([[0.0, turned_rad, 0.0]]))
        every = torch.ones(FRAMES, len(PARTS))
        parts = PartObservations(
            pixels, palms, rotations, every, every.clone(), every[:, 1:].clone()
        )
        return replace(seen, parts=parts)


def turned_in_picture(pixels: Float[Tensor, "F P 2"], angle_rad: float) -> Float[Tensor, "F P 2"]:
    """About their middle."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    middle = pixels.mean(-2, keepdim=True)
    return middle + (pixels - middle) @ torch.tensor([[cos, sin], [-sin, cos]])


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


def test_a_palm_that_points_elsewhere_costs_though_its_middle_is_in_place():
    seen, angle = seen_parts(), 0.1
    assert seen.parts is not None
    palm = seen.parts.palms_px[:, LEFT - 1]
    far = (palm - palm.mean(-2, keepdim=True)).square().sum(-1)
    squared = (angle / (DEVIATION * PERSON_PX)) ** 2 * far.mean().item()
    costs = energy_of(PartPoses, STATE, seen_parts(pointing_rad=angle))
    assert costs == pytest.approx(PALM_WEIGHT * squared, rel=0.1)


def test_larger_hands_than_the_mean_bodys_cost_nothing():
    seen = seen_parts()
    assert seen.parts is not None
    middle = seen.parts.palms_px.mean(-2, keepdim=True)
    larger = replace(seen.parts, palms_px=middle + 1.2 * (seen.parts.palms_px - middle))
    assert energy_of(PartPoses, STATE, replace(seen, parts=larger)) == pytest.approx(0.0, abs=2e-3)


def test_what_was_not_found_or_not_believed_has_no_say():
    seen = seen_parts(off_px=30.0, turned_rad=0.5, pointing_rad=0.3)
    assert seen.parts is not None
    seen.parts.turned[:, LEFT] = 0.0
    moved = energy_of(PartPoses, STATE, seen)
    only_moved = seen_parts(off_px=30.0, pointing_rad=0.3)
    assert moved == pytest.approx(energy_of(PartPoses, STATE, only_moved))
    seen.parts.palms_found[:, LEFT - 1] = 0.0
    assert energy_of(PartPoses, STATE, seen) == pytest.approx(
        energy_of(PartPoses, STATE, seen_parts(off_px=30.0))
    )
    seen.parts.found[:, LEFT] = 0.0
    assert energy_of(PartPoses, STATE, seen) == pytest.approx(0.0, abs=1e-9)


def test_gradients_are_slopes():
    seen = seen_parts()
    assert seen.parts is not None
    seen.parts.palms_found[:] = 0.0
    assert_gradients_are_slopes(PartPoses, disturbed(STATE), seen)


def test_where_a_palm_points_moves_rotations_alone():
    seen = seen_parts(pointing_rad=0.3)
    assert seen.parts is not None
    seen.parts.found[:], seen.parts.turned[:] = 0.0, 0.0
    gradients = gradients_of(PartPoses, STATE, seen)
    moving = {name for name, gradient in gradients.items() if gradient.abs().max() > 1e-9}
    assert moving <= {"root_rotation", "joint_angles"}
    assert "joint_angles" in moving
