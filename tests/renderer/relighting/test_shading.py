"""Relighting: the kernel against its twin, normals, and the light that somebody was filmed in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.reference import shading as twin
from renderer.relighting.light_estimation import estimate_light
from renderer.relighting.shading import Relighting, albedo_of, neighbours, normals_of
from renderer.splats.layout import COLOUR, ROTATION
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene import Lighting, Sequence, orbit_camera
from scene.rotations import axis_angle_to_matrix
from scene.skeleton import JOINT_COUNT
from tests.renderer.pillar import FILMED_IN, LitFrames, filmed_pillar, trained_pillar
from tests.renderer.studio import make_model


@pytest.fixture(scope="module")
def filmed() -> tuple[SplatModel, np.ndarray, Sequence]:
    return filmed_pillar()


@pytest.fixture(scope="module")
def learnt(filmed) -> tuple[np.ndarray, np.ndarray]:
    """Albedo as training finds it, and the true one, of splats that are clear of other stripes."""
    _, albedo, _ = filmed
    model = trained_pillar()
    assert model.albedo is not None
    height = model.parameters[:, 1] * 4.0
    inside = np.abs(height - np.round(height)) > 0.2
    dyes = albedo[np.argmax(albedo[:, 0])], albedo[np.argmax(albedo[:, 2])]
    bands = (np.floor(height) % 2).astype(int)
    kept = inside & model.seen
    return model.albedo[kept], np.stack(dyes)[bands][kept]


def test_the_light_that_somebody_was_filmed_in_is_divided_out(filmed, learnt):
    found, albedo = learnt
    ratio = found / albedo
    assert np.median(np.abs(ratio / np.median(ratio, axis=0) - 1.0)) < 0.06
    # as filmed, light alone makes more of a difference
    lit = FILMED_IN.shading(normals_of(filmed[0]))
    assert np.median(np.abs(lit / np.median(lit, axis=0) - 1.0)) > 0.15


def test_colours_of_clothes_are_not_taken_for_light(learnt):
    found, albedo = learnt
    blue = albedo[:, 2] > 0.5
    for channel in range(3):
        between = np.median(found[blue, channel]) / np.median(found[~blue, channel])
        truth = albedo[blue][0, channel] / albedo[~blue][0, channel]
        assert between == pytest.approx(truth, rel=0.12)


def test_frames_that_show_nothing_tell_of_no_light(filmed):
    model, _, sequence = filmed
    black = LitFrames(model, np.zeros((len(model), 3)), FILMED_IN)
    assert estimate_light(model, replace(sequence, train=black)) is None


def test_colours_survive_the_way_to_albedos_and_back(filmed):
    model, _, sequence = filmed
    light = estimate_light(model, sequence)
    assert light is not None
    back = light.with_mean_light(light.without_light(model.parameters))
    np.testing.assert_allclose(back, model.parameters, atol=1e-4)


def test_normals_point_outwards(filmed):
    model, _, _ = filmed
    swaying = model.parameters.copy()
    noise = np.random.default_rng(1).normal(0.0, 0.15, (len(model), 4))
    swaying[:, ROTATION : ROTATION + 4] += noise
    normals = normals_of(replace(model, parameters=swaying))
    outwards = model.parameters[:, :3] * [1.0, 0.0, 1.0]
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    cosine = (normals * outwards).sum(axis=1)
    assert np.percentile(cosine, 5) > 0.75
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-5)


def test_neighbours_match_brute_force():
    points = np.random.default_rng(2).normal(size=(300, 3)).astype(np.float32)
    near, distance = neighbours(points, points, 5)
    gaps = np.linalg.norm(points[:, None] - points, axis=2)
    np.testing.assert_array_equal(near, np.argsort(gaps, axis=1)[:, :5])
    np.testing.assert_allclose(distance, np.sort(gaps, axis=1)[:, :5], atol=2e-3)


def test_the_kernel_matches_its_twin():
    model, rng = make_model(), np.random.default_rng(3)
    lighting = Lighting(
        rng.normal(0.3, 0.3, (9, 3)), np.array([0.6, 0.0, 0.8]), rng.uniform(size=3)
    )
    angles = rng.normal(0.0, 0.4, (JOINT_COUNT, 3))
    transforms = model.skeleton.skinning_transforms(angles, np.zeros(3)).astype(np.float32)
    parameters = model.parameters.copy()
    joints = model.joints.astype(np.uint16)
    eye = np.array([0.5, 1.0, 3.0])
    Relighting((model,)).shade(parameters, joints, model.weights, transforms, eye, lighting)
    slow = twin.shade(
        albedo_of(model),
        model.parameters[:, :3],
        normals_of(model),
        model.joints,
        model.weights,
        transforms,
        eye,
        lighting,
    )
    np.testing.assert_allclose(parameters[:, COLOUR : COLOUR + 3], slow, atol=2e-3)
    untouched = np.delete(np.arange(parameters.shape[1]), np.arange(COLOUR, COLOUR + 3))
    np.testing.assert_array_equal(parameters[:, untouched], model.parameters[:, untouched])


def test_light_stays_in_the_room_while_a_person_turns(filmed):
    model = replace(filmed[0], albedo=np.full((len(filmed[0]), 3), 0.4, np.float32))
    from_x = Lighting(np.zeros((9, 3)), np.array([1.0, 0.0, 0.0]), np.ones(3))
    camera = orbit_camera((0.0, 0.8, 0.0), 3.0, 0.0, 0.0, 64, 64)
    renderer, rest = SplatRenderer((model,)), np.zeros((JOINT_COUNT, 3))
    for yaw in (0.0, 0.5 * np.pi, np.pi):
        turn = np.eye(4)
        turn[:3, :3] = axis_angle_to_matrix(np.array([0.0, yaw, 0.0]))
        moved = turn @ model.skeleton.skinning_transforms(rest, np.zeros(3))
        red = renderer.render(camera, [moved], from_x)[..., 0]
        # +x is on the right of what a camera at +z sees
        assert red[:, 34:].sum() > 10.0 * red[:, :30].sum() > 0.0
    blue = renderer.render(camera, [moved])[..., 2]  # as they were filmed
    assert blue[:, :32].sum() == pytest.approx(blue[:, 32:].sum(), rel=0.1)


def test_the_pull_on_albedos_is_nearly_the_slope_of_what_is_shown(filmed):
    model, _, sequence = filmed
    light = estimate_light(model, sequence)
    assert light is not None
    roots = light.without_light(model.parameters)
    moved = model.skeleton.skinning_transforms(np.zeros((JOINT_COUNT, 3)), np.zeros(3))
    place = model.joints.astype(np.uint16), model.weights, moved.astype(np.float32)
    shown, step = light.shade(roots, *place, np.array([0.0, 1.0, 3.0])), 1e-2
    more = roots.copy()
    more[:, COLOUR : COLOUR + 3] += step
    rise = (light.shade(more, *place, np.array([0.0, 1.0, 3.0])) - shown) / step
    pulled = np.ones_like(roots)
    light.chain_to_albedo(pulled, roots, shown)
    ratio = pulled[:, COLOUR : COLOUR + 3] / rise[:, COLOUR : COLOUR + 3]
    assert np.percentile(ratio, 2) > 0.8
    assert np.percentile(ratio, 98) < 1.25
    np.testing.assert_array_equal(pulled[:, :COLOUR], 1.0)
