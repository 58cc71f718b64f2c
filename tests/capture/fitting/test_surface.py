"""Vertices that the fit compares with pictures."""

from __future__ import annotations

import torch

from capture.body.model import load_body_model
from capture.fitting.kinematics import PosedBody, forward_kinematics, rotation_matrices
from capture.fitting.surface import SurfaceSamples
from scene.skeleton import JOINT_COUNT


def test_chosen_vertices_are_where_all_of_them_are():
    model = load_body_model()
    samples = SurfaceSamples.spread(model, 0.1)
    generator = torch.Generator().manual_seed(1)
    rotations = rotation_matrices(0.4 * torch.randn(3, JOINT_COUNT, 3, generator=generator))
    shape = 0.1 * torch.randn(model.shape_count, generator=generator)
    rest = torch.tensor(model.rest_joints, dtype=torch.float32) + (
        torch.tensor(model.joint_directions, dtype=torch.float32) @ shape
    )
    posed = PosedBody(*forward_kinematics(rotations, torch.zeros(3, 3), rest), rest, shape)
    every = samples.posed(posed)
    which = torch.randint(len(samples.rest), (3, 7), generator=generator)
    some = samples.posed_at(posed, which)
    expected = torch.gather(every, 1, which[..., None].expand(-1, -1, 3))
    torch.testing.assert_close(some, expected, atol=1e-5, rtol=0.0)
    torch.testing.assert_close(
        samples.normals_of(posed).norm(dim=-1), torch.ones(every.shape[:2]), atol=1e-4, rtol=0.0
    )
