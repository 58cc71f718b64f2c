"""The body in torch against the skeleton's own kinematics."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from capture.fitting.kinematics import (
    PosedBody,
    forward_kinematics,
    rotation_matrices,
    skinned_points,
)
from scene.motion import Pose
from tests.capture.people import body


def test_torch_kinematics_match_the_skeletons():
    rng = np.random.default_rng(0)
    person = body()
    assert person.rest_vertices is not None
    assert person.blend_weights is not None
    angles, root = rng.normal(0.0, 0.5, (3, 24, 3)), rng.normal(0.0, 1.0, (3, 3))
    rest = torch.tensor(person.skeleton.rest_joints)
    rotations, positions = forward_kinematics(
        rotation_matrices(torch.tensor(angles)).double(), torch.tensor(root) + rest[0], rest
    )
    wanted = person.skeleton.joint_transforms(angles, root)
    assert positions.numpy() == pytest.approx(wanted[..., :3, 3], abs=1e-6)
    assert rotations.numpy() == pytest.approx(wanted[..., :3, :3], abs=1e-6)
    chosen = np.arange(0, len(person.rest_vertices), 97)
    skin = skinned_points(
        PosedBody(rotations, positions, rest, torch.zeros(0)),
        torch.tensor(person.rest_vertices[chosen]),
        torch.tensor(person.blend_weights[chosen]),
    )
    for frame in range(3):
        truth = person.posed_vertices(Pose(angles[frame], root[frame]))[chosen]
        assert skin[frame].numpy() == pytest.approx(truth, abs=1e-6)


def test_rotations_have_gradients_at_zero():
    angles = torch.zeros(4, 3, requires_grad=True)
    rotation_matrices(angles)[:, 0, 1].sum().backward()
    assert angles.grad is not None
    assert angles.grad[:, 2].numpy() == pytest.approx(-1.0)
