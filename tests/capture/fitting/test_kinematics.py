"""The body in torch against the skeleton's own kinematics."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from capture.fitting.kinematics import (
    BlendWeights,
    PosedBody,
    forward_kinematics,
    project,
    rotation_matrices,
    skinned_points,
)
from scene.motion import Pose
from scene.skeleton import JOINT_COUNT
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
        BlendWeights.of(person.blend_weights[chosen]),
    )
    for frame in range(3):
        truth = person.posed_vertices(Pose(angles[frame], root[frame]))[chosen]
        assert skin[frame].numpy() == pytest.approx(truth, abs=1e-6)


def test_rotations_have_gradients_at_zero():
    angles = torch.zeros(4, 3, requires_grad=True)
    rotation_matrices(angles)[:, 0, 1].sum().backward()
    assert angles.grad is not None
    assert angles.grad[:, 2].numpy() == pytest.approx(-1.0)


@pytest.mark.parametrize("size_rad", [1e-9, 1e-3, 9e-3, 1.1e-2, 0.5, 3.0])
def test_gradients_of_rotations_are_those_of_finite_differences(size_rad):
    angles = noise(5, 3, deviation=1.0)
    angles = size_rad * angles / angles.norm(dim=1, keepdim=True)
    assert torch.autograd.gradcheck(rotation_matrices, angles.requires_grad_())


def test_gradients_of_the_chain_are_those_of_finite_differences():
    rotations = rotation_matrices(noise(2, JOINT_COUNT, 3, deviation=0.5))
    given = rotations, noise(2, 3), torch.tensor(body().skeleton.rest_joints)
    assert torch.autograd.gradcheck(
        forward_kinematics, [value.detach().requires_grad_() for value in given]
    )


def test_gradients_of_skinning_are_those_of_finite_differences_some_vertices_asked_for_twice():
    weights = BlendWeights(
        np.array([[3, 5, 0], [5, 3, 23], [7, 0, 0], [2, 1, 0]]),
        np.array([[0.5, 0.3, 0.2], [0.6, 0.4, 0.0], [1.0, 0.0, 0.0], [0.7, 0.3, 0.0]], np.float32),
    )
    which = np.array([[0, 1, 2, 2], [3, 0, 0, 1]])

    def skinned(rotations, positions, rest, points):
        posed = PosedBody(rotations, positions, rest, torch.zeros(0))
        return skinned_points(posed, points, weights, which)

    rotations = noise(2, JOINT_COUNT, 3, 3)
    given = rotations, noise(2, JOINT_COUNT, 3), noise(JOINT_COUNT, 3), noise(4, 3)
    assert torch.autograd.gradcheck(skinned, [value.requires_grad_() for value in given])


def test_gradients_of_projection_are_those_of_finite_differences_and_end_at_the_camera():
    points = noise(7, 3) - torch.tensor([0.0, 0.0, 3.0])
    points[0, 2] = 1.0  # behind it
    focal, centre = torch.tensor(500.0).double(), torch.tensor([320.0, 240.0])
    given = points.requires_grad_(), focal.requires_grad_()
    assert torch.autograd.gradcheck(lambda points, focal: project(points, focal, centre), given)
    project(points, focal, centre).sum().backward()
    assert points.grad is not None
    assert points.grad[0, 2] == 0.0
    assert torch.isfinite(points.grad).all()


def noise(*shape: int, deviation: float = 1.0) -> torch.Tensor:
    """Of double precision, the same each time."""
    generator = torch.Generator().manual_seed(0)
    return deviation * torch.randn(*shape, generator=generator, dtype=torch.float64)
