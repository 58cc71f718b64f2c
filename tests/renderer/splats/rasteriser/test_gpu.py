"""The GPU's rasteriser against the CPU's, by Triton's interpreter where there is no GPU."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.devices import best_device
from renderer.splats.layout import COLOUR
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.gpu import GpuSplatRenderer, splat_renderer
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene import Motion, Pose, Skeleton
from scene.lighting import Lighting
from scene.live_appearance import LiveAppearance
from tests.renderer.splats.rasteriser.test_rasteriser import make_camera, make_scene


def made_model(count: int, seed: int = 0) -> tuple[SplatModel, np.ndarray]:
    parameters, joints, weights, turned = make_scene(count, seed)
    model = SplatModel(
        parameters,
        joints.astype(np.uint8),
        weights,
        np.ones(count, bool),
        Skeleton(np.zeros((24, 3))),
        Motion.from_poses([Pose.rest()]),
        "",
    )
    transforms = np.tile(np.eye(4, dtype=np.float32), (24, 1, 1))
    transforms[: len(turned)] = turned
    return model, transforms


def both_renderers(models) -> tuple[SplatRenderer, GpuSplatRenderer]:
    return SplatRenderer(models), GpuSplatRenderer(models, best_device())


@pytest.mark.parametrize(
    ("count", "width", "height"),
    [(300, 72, 56), (1, 16, 16), (40, 33, 90)],
    ids=["many", "one", "odd size"],
)
def test_pictures_and_tiles_are_the_cpus(count, width, height):
    model, transforms = made_model(count)
    cpu, gpu = both_renderers((model,))
    camera = make_camera(width, height)
    expected = cpu.render(camera, [transforms])
    np.testing.assert_allclose(gpu.render(camera, [transforms]), expected, atol=2e-3)
    np.testing.assert_array_equal(gpu.tiles, cpu.tiles)


def test_splats_of_other_levels_are_not_drawn_and_come_back():
    model, transforms = made_model(60)
    cpu, gpu = both_renderers((model,))
    camera, some = make_camera(48, 48), np.arange(60) % 3 > 0
    whole = cpu.render(camera, [transforms]).copy()
    for renderer in (cpu, gpu):
        renderer.draw_only(some)
    expected = cpu.render(camera, [transforms])
    assert np.abs(expected - whole).max() > 0.1
    np.testing.assert_allclose(gpu.render(camera, [transforms]), expected, atol=2e-3)
    for renderer in (cpu, gpu):
        renderer.draw_only(np.ones(60, bool))
    np.testing.assert_array_equal(cpu.render(camera, [transforms]), whole)
    np.testing.assert_allclose(gpu.render(camera, [transforms]), whole, atol=2e-3)


def test_people_hide_each_other_in_one_pass():
    near, transforms = made_model(60)
    far, _ = made_model(60, seed=3)
    away = transforms.copy()
    away[:, 2, 3] -= 0.4
    cpu, gpu = both_renderers((near, far))
    camera = make_camera(48, 48)
    expected = cpu.render(camera, [transforms, away])
    np.testing.assert_allclose(gpu.render(camera, [transforms, away]), expected, atol=2e-3)


def test_live_colours_are_those_of_a_repainted_model_and_leave_the_next_picture_again():
    near, transforms = made_model(60)
    far, _ = made_model(60, seed=3)
    change = np.random.default_rng(2).normal(0.0, 0.3, (60, 3)).astype(np.float32)
    parameters, colours = far.parameters.copy(), slice(COLOUR, COLOUR + 3)
    parameters[:, colours] = np.clip(parameters[:, colours] + change, 0.0, 1.0)
    away = transforms.copy()
    away[:, 2, 3] -= 0.4
    cpu, gpu = both_renderers((near, far))
    camera, moved = make_camera(48, 48), [transforms, away]
    plain = cpu.render(camera, moved).copy()
    expected = SplatRenderer((near, replace(far, parameters=parameters))).render(camera, moved)
    assert np.abs(expected - plain).max() > 0.1
    for renderer, atol in ((cpu, 1e-5), (gpu, 2e-3)):
        changed = renderer.render(camera, moved, appearances=[None, LiveAppearance(change)])
        np.testing.assert_allclose(changed, expected, atol=atol)
        np.testing.assert_allclose(renderer.render(camera, moved), plain, atol=atol)


def test_light_falls_on_the_next_picture_and_leaves_it_again():
    model, transforms = made_model(80)
    cpu, gpu = both_renderers((model,))
    camera = make_camera(32, 32)
    plain = gpu.render(camera, [transforms]).copy()
    light = Lighting(np.full((9, 3), 0.3), np.array([0.0, 1.0, 0.0]), np.array([0.5, 0.2, 0.1]))
    expected = cpu.render(camera, [transforms], light)
    lit = gpu.render(camera, [transforms], light).copy()
    np.testing.assert_allclose(lit, expected, atol=2e-3)
    assert np.abs(lit - plain).max() > 0.05
    np.testing.assert_array_equal(gpu.render(camera, [transforms]), plain)


def test_the_light_of_a_clip_falls_as_on_the_cpu():
    model, transforms = made_model(80)
    light = np.random.default_rng(1).normal(0.5, 0.4, (9, 3)).astype(np.float32)
    cpu, gpu = both_renderers((replace(model, light=light),))
    camera = make_camera(32, 32)
    expected = cpu.render(camera, [transforms]).copy()
    np.testing.assert_allclose(gpu.render(camera, [transforms]), expected, atol=2e-3)
    baked = SplatRenderer((model,)).render(camera, [transforms])
    assert np.abs(expected - baked).max() > 0.05


def test_splats_behind_the_camera_or_too_faint_are_not_drawn():
    model, transforms = made_model(50)
    behind = transforms.copy()
    behind[:, 2, 3] += 5.0
    faint = model.parameters.copy()
    faint[:, 13] = -20.0
    camera = make_camera(32, 32)
    gpu = GpuSplatRenderer((model,), best_device())
    assert not gpu.render(camera, [behind]).any()
    assert not gpu.tiles.any()
    nobody = GpuSplatRenderer((replace(model, parameters=faint),), best_device())
    assert not nobody.render(camera, [transforms]).any()


def test_depth_and_normals_are_told_of_the_picture_shown_last():
    model, transforms = made_model(30)
    cpu, gpu = both_renderers((model,))
    camera = make_camera(24, 24)
    cpu.render(camera, [transforms])
    gpu.render(camera, [transforms])
    one, other = cpu.geometry([transforms]), gpu.geometry([transforms])
    np.testing.assert_allclose(other.depth, one.depth, atol=1e-6)
    np.testing.assert_allclose(other.normal, one.normal, atol=1e-6)


def test_the_fastest_renderer_of_this_machine_is_taken():
    model, _ = made_model(5)
    on_gpu = best_device().type == "cuda"
    assert isinstance(splat_renderer((model,)), GpuSplatRenderer) is on_gpu
