"""Inverse skinning: against its twin, against the forward kind, and its gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from renderer.field.skinning.inverse_skinning import (
    WeightVolume,
    blended_inverse,
    inverse_skinning,
    reached_skinning,
    rotations,
    skinning_transforms,
)
from renderer.field.skinning.rest_shape import rest_shape
from renderer.reference import inverse_skinning as twin
from scene.rotations import axis_angle_to_matrix
from scene.skeleton import PARENTS
from tests.renderer.field.performer import body, pose


def _transforms(turn: float = 0.4, bend: float = 0.6) -> torch.Tensor:
    moment = pose(turn, bend)
    full = body().skeleton.skinning_transforms(moment.joint_angles, moment.root_translation)
    return torch.from_numpy(full[:, :3])


@pytest.fixture(scope="module")
def smooth() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """A random volume on a box round the body: every gradient is far from nil."""
    generator = torch.Generator().manual_seed(0)
    volume = torch.softmax(torch.rand(25, 6, 7, 8, generator=generator).double(), dim=0)
    return volume, torch.tensor([-1.0, -0.2, -1.0]).double(), torch.tensor([1.0, 2.0, 1.0]).double()


def _points(count: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(3)
    return torch.rand(count, 3, generator=generator).double() * torch.tensor(
        [0.6, 1.4, 0.4]
    ) + torch.tensor([-0.3, 0.1, -0.2])


def test_rotations_agree_with_the_scene():
    angles = np.random.default_rng(0).normal(size=(20, 3))
    angles[0] = 0.0
    got = rotations(torch.from_numpy(angles)).numpy()
    assert np.allclose(got, axis_angle_to_matrix(angles), atol=1e-9)


def test_rotations_have_a_gradient_at_zero():
    angle = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    rotations(angle)[0, 1].backward()
    assert angle.grad is not None
    assert torch.allclose(angle.grad, torch.tensor([0.0, 0.0, -1.0]).double())


def test_kinematics_agree_with_the_skeleton():
    moment = pose(1.0, 0.7)
    got = skinning_transforms(
        rotations(torch.from_numpy(moment.joint_angles)),
        torch.tensor([0.1, 0.2, 0.3]).double(),
        torch.from_numpy(body().skeleton.rest_joints),
        PARENTS,
    )
    expected = body().skeleton.skinning_transforms(moment.joint_angles, np.array([0.1, 0.2, 0.3]))
    assert np.allclose(got.numpy(), expected[:, :3], atol=1e-9)


def test_agrees_with_the_slow_twin(smooth):
    volume, low, high = smooth
    points, transforms = _points(12), _transforms()
    got = inverse_skinning(points, transforms, WeightVolume.of(volume, low, high))
    expected = twin.inverse_skinning(points, transforms, volume, low, high)
    for one, other in zip(got, expected, strict=True):
        assert torch.allclose(one, other, atol=1e-9)


def test_gradients_against_finite_differences(smooth):
    volume, low, high = smooth

    def skinned(points: torch.Tensor, angles: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
        rest = torch.from_numpy(body().skeleton.rest_joints)
        local = torch.cat([rotations(angles), torch.eye(3).double().expand(20, 3, 3)])
        transforms = skinning_transforms(local, torch.zeros(3).double(), rest, PARENTS)
        return inverse_skinning(points, transforms, WeightVolume.of(weights, low, high))[0]

    generator = torch.Generator().manual_seed(7)
    angles = 0.3 * torch.rand(4, 3, generator=generator).double()
    inputs = [_points(2), angles, volume[:, ::3, ::3, ::3].contiguous()]
    assert torch.autograd.gradcheck(skinned, [i.requires_grad_(True) for i in inputs], atol=1e-6)


def test_exact_rounds_invert_forward_skinning():
    person = body()
    assert person.rest_vertices is not None
    assert person.blend_weights is not None
    shape = rest_shape(person, (32, 96, 96), 0.04)
    volume = WeightVolume.of(
        torch.from_numpy(shape.prior), torch.from_numpy(shape.low), torch.from_numpy(shape.high)
    )
    moment = pose(0.5, 1.2)
    posed = torch.from_numpy(person.posed_vertices(moment)[::40]).float()
    rest = torch.from_numpy(person.rest_vertices[::40]).float()
    transforms = _transforms(0.5, 1.2).float()
    found, likelihood = inverse_skinning(posed, transforms, volume)
    first = (found - rest).norm(dim=1)
    for _ in range(3):
        found = blended_inverse(posed, transforms, volume.at(found))
    last = (found - rest).norm(dim=1)
    assert (likelihood > 0.9).float().mean() > 0.99
    assert last.median() < 0.001
    assert last.mean() < 0.6 * first.mean()


def test_known_weights_invert_to_rounding():
    generator = torch.Generator().manual_seed(2)
    weights = torch.softmax(torch.rand(9, 24, generator=generator).double(), dim=1)
    points, transforms = _points(9), _transforms(0.2, 0.3)
    blend = torch.einsum("nk,kij->nij", weights, transforms)
    posed = torch.einsum("nij,nj->ni", blend[:, :, :3], points) + blend[:, :, 3]
    assert torch.allclose(blended_inverse(posed, transforms, weights), points, atol=1e-9)


def test_places_without_weight_stay():
    points = _points(3)
    assert torch.equal(blended_inverse(points, _transforms(), torch.zeros(3, 24).double()), points)


def test_rays_that_meet_nothing_ask_nothing(smooth):
    boxes = smooth[1].expand(24, 3), smooth[2].expand(24, 3)
    points = torch.zeros(0, 3).double()
    found, likelihood = reached_skinning(points, _transforms(), WeightVolume.of(*smooth), boxes)
    assert (found.shape, likelihood.shape) == ((0, 3), (0,))
