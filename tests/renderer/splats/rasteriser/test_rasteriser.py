"""The numba rasteriser against its plain torch twin, forward and backward; the twin against
finite differences."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from renderer.reference import splats as twin
from renderer.splats.layout import BOX_FILTER_PX2, PARAMETERS, UNKNOWN
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.workspace import Workspace, pack_camera
from scene import Motion, Pose, Skeleton, look_at
from scene.camera import Camera
from scene.rotations import axis_angle_to_matrix

JOINTS = 3
LINEAR_FROM = 0.2
DILATION = 0.3


def make_scene(count: int, seed: int = 0):
    """`count` splats of up to a tenth of a metre around the origin, on three moving bones."""
    rng = np.random.default_rng(seed)
    parameters = np.zeros((count, PARAMETERS), np.float32)
    parameters[:, :3] = rng.uniform(-0.4, 0.4, (count, 3))
    parameters[:, 3:6] = np.log(rng.uniform(0.01, 0.1, (count, 3)))
    parameters[:, 6:10] = rng.normal(size=(count, 4))
    parameters[:, 10:13] = rng.uniform(0, 1, (count, 3))
    parameters[:, 13] = rng.uniform(-2, 2, count)
    joints = np.tile(np.array([0, 1, 2, 0], np.uint16), (count, 1))
    weights = np.zeros((count, 4), np.float32)
    weights[:, :3] = rng.dirichlet([1, 1, 1], count)
    transforms = np.tile(np.eye(4, dtype=np.float32), (JOINTS, 1, 1))
    transforms[:, :3, :3] = axis_angle_to_matrix(0.3 * rng.normal(size=(JOINTS, 3)))
    transforms[:, :3, 3] = 0.05 * rng.normal(size=(JOINTS, 3))
    return parameters, joints, weights, transforms


def make_camera(width: int, height: int) -> Camera:
    return Camera.from_field_of_view(look_at((0.3, 0.2, 2.0), (0, 0, 0)), width, height, 0.6)


def dense_weights(weights) -> torch.Tensor:
    return torch.tensor(weights[:, :JOINTS].astype(np.float64))


def draw_fast(scene, camera: Camera, dilation: float = DILATION) -> np.ndarray:
    from renderer.splats.rasteriser.tile_kernels import draw

    parameters, joints, weights, transforms = scene
    work = Workspace(len(parameters))
    size = (camera.width, camera.height)
    work.arrange(parameters, joints, weights, transforms, pack_camera(camera), *size, dilation)
    out = np.full((camera.height, camera.width, 4), np.nan, np.float32)
    draw(work.projected, work.starts, work.entries, 2, out)
    return out


def draw_slow(scene, camera: Camera) -> np.ndarray:
    parameters, _, weights, transforms = scene
    return twin.draw(
        torch.tensor(parameters.astype(np.float64)),
        dense_weights(weights),
        torch.tensor(transforms.astype(np.float64)),
        torch.tensor(pack_camera(camera).astype(np.float64)),
        camera.width,
        camera.height,
        DILATION,
    ).numpy()


@pytest.mark.parametrize(("count", "width", "height"), [(1, 32, 32), (60, 50, 37), (200, 64, 48)])
def test_picture_matches_the_twin(count, width, height):
    scene, camera = make_scene(count, seed=count), make_camera(width, height)
    fast, slow = draw_fast(scene, camera), draw_slow(scene, camera)
    # the kernel leaves out what is fainter than 1/255 and stops when 1/512 is left
    assert np.abs(fast - slow).max() < 0.012
    assert np.abs(fast - slow).mean() < 1e-3


def test_depth_is_blended_as_colours_are():
    from renderer.splats.rasteriser.renderer import SplatRenderer

    scene, camera = make_scene(80, seed=4), make_camera(64, 48)
    parameters, joints, weights, transforms = scene
    skeleton = Skeleton(np.zeros((24, 3)))
    motion = Motion.from_poses([Pose.rest()])
    model = SplatModel(
        parameters, joints.astype(np.uint8), weights, np.ones(80, bool), skeleton, motion, ""
    )
    every = np.tile(np.eye(4, dtype=np.float32), (24, 1, 1))
    every[:JOINTS] = transforms
    renderer = SplatRenderer([model])
    shown = renderer.render(camera, [every]).copy()
    geometry = renderer.geometry([every])
    packed = torch.tensor(pack_camera(camera).astype(np.float64))
    leaf = torch.tensor(parameters.astype(np.float64))
    moved = torch.tensor(transforms.astype(np.float64))
    _, _, depth = twin.skin_and_project(leaf, dense_weights(weights), moved, packed, BOX_FILTER_PX2)
    leaf[:, 10:13] = depth[:, None]
    slow = twin.draw(leaf, dense_weights(weights), moved, packed, 64, 48, BOX_FILTER_PX2).numpy()
    assert np.abs(geometry.depth - slow[..., 0]).max() < 0.03
    assert np.abs(geometry.alpha - slow[..., 3]).max() < 0.012
    solid = geometry.alpha > 0.9
    expected = geometry.depth[solid] / geometry.alpha[solid]
    assert (np.abs(expected - 2.0) < 0.8).all()  # they lie round the origin, 2 m away
    assert (np.linalg.norm(geometry.normal, axis=2) <= geometry.alpha + 1e-3).all()
    np.testing.assert_array_equal(renderer.render(camera, [every]), shown)  # nothing was spoilt


def test_an_empty_scene_is_transparent():
    assert (draw_fast(make_scene(0), make_camera(20, 20)) == 0.0).all()


def test_splats_behind_and_beside_the_camera_are_not_drawn():
    parameters, joints, weights, transforms = make_scene(2)
    parameters[0, :3], parameters[1, :3] = [0.3, 0.2, 3.0], [50.0, 0.0, 0.0]
    transforms[:] = np.eye(4)
    out = draw_fast((parameters, joints, weights, transforms), make_camera(32, 32))
    assert (out == 0.0).all()


def test_a_splat_smaller_than_a_pixel_keeps_its_colour():
    parameters, joints, weights, transforms = make_scene(1)
    parameters[0, :6] = [0, 0, 0, *np.log([1e-4] * 3)]
    parameters[0, 10:] = [0.2, 0.4, 0.8, 4.0]
    transforms[:] = np.eye(4)
    out = draw_fast((parameters, joints, weights, transforms), make_camera(32, 32))
    peak = out[np.unravel_index(out[..., 3].argmax(), out.shape[:2])]
    np.testing.assert_allclose(peak[:3] / peak[3], [0.2, 0.4, 0.8], atol=1e-3)


@pytest.mark.parametrize("deviation_m", [0.02, 0.03])
def test_the_pixels_filter_makes_no_more_light_of_a_splat(deviation_m):
    parameters, joints, weights, transforms = make_scene(1)
    parameters[0, :6], parameters[0, 13] = [0, 0, 0, *np.log([deviation_m] * 3)], 1.0
    transforms[:] = np.eye(4)
    scene = (parameters, joints, weights, transforms)
    coarse, fine = (
        draw_fast(scene, make_camera(side, side), BOX_FILTER_PX2)[..., 3].sum() / side**2
        for side in (32, 256)
    )
    assert coarse == pytest.approx(fine, rel=0.01)


def test_nearer_splats_hide_farther_ones():
    parameters, joints, weights, transforms = make_scene(2)
    parameters[:, :3] = [[0, 0, 0], [-0.03, -0.02, -0.2]]  # one behind the other
    parameters[:, 3:6], parameters[:, 13] = np.log(0.08), 8.0
    parameters[:, 10:13] = [[1, 0, 0], [0, 1, 0]]
    transforms[:] = np.eye(4)
    out = draw_fast((parameters, joints, weights, transforms), make_camera(33, 33))
    assert out[16, 16, 0] > 0.95
    assert out[16, 16, 1] < 0.05


def gradients_fast(scene, camera: Camera, target, background):
    from renderer.splats.rasteriser.projection_kernels import chain_rule
    from renderer.splats.rasteriser.tile_kernels import draw_and_differentiate
    from renderer.splats.training.adam_kernels import sum_threads

    parameters, joints, weights, transforms = scene
    count, packed = len(parameters), pack_camera(camera)
    work = Workspace(count)
    work.arrange(
        parameters, joints, weights, transforms, packed, camera.width, camera.height, DILATION
    )
    threads = np.zeros((2, count, 10), np.float32)
    losses, total = np.zeros(2), np.zeros((count, 10), np.float32)
    draw_and_differentiate(
        work.projected, work.starts, work.entries, target, background, LINEAR_FROM, threads, losses
    )
    sum_threads(threads, total)
    assert (threads == 0.0).all()
    by_parameter = np.zeros_like(parameters)
    chain_rule(
        parameters,
        joints,
        weights,
        transforms,
        packed,
        work.projected,
        work.boxes,
        total,
        2,
        by_parameter,
    )
    return losses.sum(), by_parameter


def gradients_slow(scene, camera: Camera, target, background):
    parameters, _, weights, transforms = scene
    leaf = torch.tensor(parameters.astype(np.float64), requires_grad=True)
    moved = torch.tensor(transforms.astype(np.float64))
    packed = torch.tensor(pack_camera(camera).astype(np.float64))
    out = twin.draw(
        leaf, dense_weights(weights), moved, packed, camera.width, camera.height, DILATION
    )
    wanted = torch.tensor(target / 255.0)
    ground = torch.tensor(background.astype(np.float64))
    shown = out[..., :3] + (1 - out[..., 3:]) * ground
    truth = wanted[..., :3] + (1 - wanted[..., 3:]) * ground
    loss = torch.nn.functional.huber_loss(shown, truth, reduction="sum", delta=LINEAR_FROM)
    loss = loss / LINEAR_FROM
    loss.backward()
    assert leaf.grad is not None
    return loss.item(), leaf.grad.numpy()


def test_pixels_that_tell_nothing_teach_nothing():
    """What two halves teach is what the whole teaches."""
    scene, camera = make_scene(50, seed=3), make_camera(48, 40)
    whole = np.random.default_rng(5).integers(0, 120, (40, 48, 4)).astype(np.uint8)
    left, right = whole.copy(), whole.copy()
    left[:, 20:], right[:, :20] = UNKNOWN, UNKNOWN
    background = np.array([0.2, 0.7, 0.4], np.float32)
    (all_loss, all_slopes), *halves = (
        gradients_fast(scene, camera, target, background) for target in (whole, left, right)
    )
    assert min(loss for loss, _ in halves) > 0.1 * all_loss
    assert sum(loss for loss, _ in halves) == pytest.approx(all_loss, rel=1e-4)
    error = np.abs(sum(slopes for _, slopes in halves) - all_slopes)
    assert error.max() < 1e-3 * np.abs(all_slopes).max()


def test_gradients_match_the_twin():
    scene, camera = make_scene(50, seed=3), make_camera(48, 40)
    rng = np.random.default_rng(5)
    target = rng.integers(0, 120, (40, 48, 4)).astype(np.uint8)
    background = np.array([0.2, 0.7, 0.4], np.float32)
    fast, slow = (f(scene, camera, target, background) for f in (gradients_fast, gradients_slow))
    assert fast[0] == pytest.approx(slow[0], rel=3e-3)
    mine, true = fast[1], slow[1]
    cosine = (mine * true).sum() / (np.linalg.norm(mine) * np.linalg.norm(true))
    assert cosine > 0.9995
    assert np.linalg.norm(mine) == pytest.approx(np.linalg.norm(true), rel=0.02)
    for columns in (slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13), slice(13, 14)):
        mine, true = fast[1][:, columns], slow[1][:, columns]
        cosine = (mine * true).sum() / (np.linalg.norm(mine) * np.linalg.norm(true))
        assert cosine > 0.995, columns


def test_a_splat_behind_rows_that_let_nothing_through_is_not_pulled():
    """Forward leaves such rows out, and so must the way back, though the tile is still open."""
    parameters, joints, weights, transforms = make_scene(41)
    away = -np.array([0.3, 0.2, 2.0]) / np.linalg.norm([0.3, 0.2, 2.0])
    parameters[:, :3] = np.linspace(0.0, 0.4, 41)[:, None] * away  # in a line from the camera
    parameters[:, 3:6], parameters[:, 6:10] = np.log([1.0, 0.15, 0.01]), [1.0, 0.0, 0.0, 0.0]
    parameters[40, 3:6], parameters[:, 13] = np.log(0.01), 8.0  # a dot behind a band
    transforms[:] = np.eye(4)
    scene, background = (parameters, joints, weights, transforms), np.ones(3, np.float32)
    target = np.zeros((16, 16, 4), np.uint8)
    _, gradient = gradients_fast(scene, make_camera(16, 16), target, background)
    assert (np.abs(gradient[:16]).max(axis=1) > 0.0).all()
    assert (gradient[40] == 0.0).all()
    alone = (parameters[40:], joints[40:], weights[40:], transforms)
    _, seen = gradients_fast(alone, make_camera(16, 16), target, background)
    assert np.abs(seen).max() > 0.01


def test_the_twin_matches_finite_differences():
    parameters, _, weights, transforms = make_scene(3, seed=2)
    camera = torch.tensor(pack_camera(make_camera(7, 6)).astype(np.float64))

    def picture(leaf, moved):
        return twin.draw(leaf, dense_weights(weights), moved, camera, 7, 6, DILATION)

    leaf = torch.tensor(parameters.astype(np.float64), requires_grad=True)
    moved = torch.tensor(transforms.astype(np.float64), requires_grad=True)
    assert torch.autograd.gradcheck(picture, (leaf, moved), eps=1e-6, atol=1e-5)
