"""What splats lack in their pixels, against autograd of the plain twin; and where the steps end."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from renderer.reference import splats as twin
from renderer.splats.layout import BLUE, COLOUR, DIFFERENCE, GATHERED, KNOWN, RED, SHOWN
from renderer.splats.rasteriser.backprojection_kernels import gather_differences
from renderer.splats.rasteriser.workspace import Workspace, pack_camera
from tests.renderer.splats.rasteriser.test_rasteriser import (
    DILATION,
    dense_weights,
    draw_fast,
    make_camera,
    make_scene,
)

MOST = 0.3


def arranged(scene, camera) -> Workspace:
    parameters, joints, weights, transforms = scene
    work, packed = Workspace(len(parameters)), pack_camera(camera)
    work.arrange(
        parameters, joints, weights, transforms, packed, camera.width, camera.height, DILATION
    )
    return work


def gathered(work: Workspace, wanted: np.ndarray, threads: int = 2) -> np.ndarray:
    out = np.zeros((threads, len(work.projected), GATHERED), np.float32)
    gather_differences(work.projected, work.starts, work.entries, wanted, MOST, out)
    return out.sum(axis=0)


@pytest.mark.parametrize(("count", "width", "height"), [(60, 50, 37), (200, 64, 48)])
def test_sums_are_those_of_autograd(count, width, height):
    scene, camera = make_scene(count), make_camera(width, height)
    rng = np.random.default_rng(1)
    wanted = rng.uniform(0, 1, (height, width, 4)).astype(np.float32)
    wanted[..., 3] = rng.integers(0, 2, (height, width))
    parameters, _, weights, transforms = scene
    leaf = torch.tensor(parameters.astype(np.float64), requires_grad=True)
    picture = twin.draw(
        leaf,
        dense_weights(weights),
        torch.tensor(transforms.astype(np.float64)),
        torch.tensor(pack_camera(camera).astype(np.float64)),
        width,
        height,
        DILATION,
    )
    covered = picture[..., 3:].detach()
    known = torch.tensor(wanted[..., 3:].astype(np.float64)) * covered
    lacks = torch.tensor(wanted[..., :3].astype(np.float64)) - picture[..., :3].detach() / (
        covered.clamp(min=1e-9)
    )
    ways = (known * lacks.clamp(-MOST, MOST), known.expand(-1, -1, 3), torch.ones_like(lacks))
    sums = [
        torch.autograd.grad((way * picture[..., :3]).sum(), leaf, retain_graph=True)[0]
        for way in ways
    ]
    found = gathered(arranged(scene, camera), wanted)
    scale = float(sums[2].abs().max())
    for column, of in ((DIFFERENCE, sums[0]), (KNOWN, sums[1]), (SHOWN, sums[2])):
        expected = of[:, COLOUR : COLOUR + 3].numpy()
        expected = expected if column == DIFFERENCE else expected[:, :1]
        got = found[:, column : column + expected.shape[1]]
        np.testing.assert_allclose(got, expected, rtol=0.05, atol=3e-3 * scale)


def test_steps_end_at_the_picture():
    scene, camera = make_scene(150, seed=4), make_camera(64, 64)
    repainted = scene[0].copy()
    repainted[:, COLOUR : COLOUR + 3] = np.clip(repainted[:, COLOUR : COLOUR + 3] * 0.5 + 0.1, 0, 1)
    truth = draw_fast((repainted, *scene[1:]), camera)
    wanted = np.concatenate([truth[..., :3] / np.maximum(truth[..., 3:], 1e-6), truth[..., 3:]], 2)
    work = arranged(scene, camera)
    for _ in range(60):
        found = gathered(work, wanted.astype(np.float32))
        work.projected[:, RED : BLUE + 1] += found[:, :3] / (found[:, KNOWN, None] + 1e-3)
    painted = scene[0].copy()
    painted[:, COLOUR : COLOUR + 3] = work.projected[:, RED : BLUE + 1]
    off = np.abs(draw_fast((painted, *scene[1:]), camera) - truth)[..., :3]
    assert off.mean() < 0.004
    assert np.abs(draw_fast(scene, camera) - truth)[..., :3].mean() > 0.03
