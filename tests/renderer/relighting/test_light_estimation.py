"""People as filmed: the light of their clip falls on them as they turn, and comes with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.evaluation.metrics import psnr
from renderer.performer_model import PerformerModel
from renderer.reference import shading as twin
from renderer.relighting.light_estimation import estimate_light
from renderer.relighting.shading import albedo_of, normals_of
from renderer.scene_renderer import SceneRenderer
from renderer.splats.layout import COLOUR
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.training import train
from scene import Environment, Lighting, Performer, Pose, Scene, orbit_camera
from scene.environment import placement
from scene.sequence import FrameSource
from scene.skeleton import JOINT_COUNT
from tests.renderer.clocks import ticking
from tests.renderer.pillar import FILMED_IN, PRESET, LitFrames, filmed_pillar, trained_pillar
from tests.renderer.studio import make_model

UP = np.array([0.0, 1.0, 0.0])
ROOM = Lighting(np.full((9, 3), 0.2), UP, np.array([0.4, 0.3, 0.2]))


def with_light(seed: int) -> SplatModel:
    """A box that was filmed in a light of its own."""
    model, rng = make_model(300), np.random.default_rng(seed)
    light = np.concatenate([[[2.5, 2.5, 2.5]], rng.normal(0.0, 0.4, (8, 3))])
    albedo = rng.uniform(0.1, 0.8, (len(model), 3)).astype(np.float32)
    return replace(model, albedo=albedo, normals=normals_of(model), light=light.astype(np.float32))


def coloured(model: SplatModel, place: np.ndarray, moved: np.ndarray, eye: np.ndarray):
    """`model` with the colours that its light gives it by the twin, in the world of its clip."""
    assert model.light is not None
    home = np.linalg.inv(place)
    parameters = model.parameters.copy()
    parameters[:, COLOUR : COLOUR + 3] = twin.shade(
        albedo_of(model),
        parameters[:, :3],
        normals_of(model),
        model.joints,
        model.weights,
        home @ moved,
        home[:3, :3] @ eye + home[:3, 3],
        Lighting(model.light, UP, np.zeros(3)),
    )
    return replace(model, parameters=parameters, light=None)


def test_everybody_is_in_the_light_of_their_own_clip_and_brings_it_along():
    cast = (with_light(1), make_model(200), with_light(2))
    placements = [
        placement(np.array([x, 0.0, 0.2 * x]), yaw) for x, yaw in ((-0.7, 0.8), (0, 1), (0.7, -2.0))
    ]
    angles = np.random.default_rng(3).normal(0.0, 0.3, (3, JOINT_COUNT, 3))
    moved = [
        place @ model.skeleton.skinning_transforms(turns, np.zeros(3))
        for model, place, turns in zip(cast, placements, angles, strict=True)
    ]
    camera = orbit_camera((0.0, 0.8, 0.0), 4.0, 0.3, 0.1, 64, 64)
    renderer = SplatRenderer(cast)
    shown = renderer.render(camera, moved, None, placements).copy()
    known = [
        model if model.light is None else coloured(model, place, way, camera.position)
        for model, place, way in zip(cast, placements, moved, strict=True)
    ]
    expected = SplatRenderer(known).render(camera, moved)
    np.testing.assert_allclose(shown, expected, atol=3e-3)
    baked = SplatRenderer([replace(m, light=None) for m in cast]).render(camera, moved)
    assert np.abs(baked - expected).max() > 0.1
    # a room's light on all of them leaves nothing behind
    assert np.abs(renderer.render(camera, moved, ROOM, placements) - shown).max() > 0.1
    np.testing.assert_array_equal(renderer.render(camera, moved, None, placements), shown)


def test_whoever_is_turned_in_the_room_is_turned_with_their_light():
    model = with_light(4)

    def seen(yaw: float, azimuth: float) -> np.ndarray:
        performer: Performer[PerformerModel] = Performer(
            "one", model, np.zeros(3), yaw, Pose.rest()
        )
        camera = orbit_camera((0.0, 0.8, 0.0), 3.0, azimuth, 0.1, 64, 64)
        return SceneRenderer().render(Scene(Environment(), (performer,)), camera).astype(int)

    # the studio looks the same from both sides
    assert np.abs(seen(np.pi, np.pi) - seen(0.0, 0.0)).max() <= 2


def test_what_nobody_filmed_fades_in_the_same_light():
    model = with_light(5)
    seen = model.parameters[:, 1] > 0.8
    faded = replace(model, seen=seen).filmed_parts()
    assert faded.light is model.light


def test_a_model_that_found_its_light_is_nearer_to_its_frames_by_it():
    source, learnt = filmed_pillar()[2].train, trained_pillar()
    figures = [
        [psnr(_over_black(model, source, i), source.image(i)) for i in range(len(source))]
        for model in (learnt, replace(learnt, light=None))
    ]
    assert np.mean(figures[0]) > np.mean(figures[1]) + 1.5


def test_even_light_comes_out_even():
    model, albedo, sequence = filmed_pillar()
    even = Lighting(FILMED_IN.harmonics * np.eye(9)[:, :1], UP, np.zeros(3))
    found = estimate_light(model, replace(sequence, train=LitFrames(model, albedo, even)))
    assert found is not None
    shading = Lighting(found.harmonics, UP, np.zeros(3)).shading(normals_of(model))
    assert np.abs(shading / np.median(shading, axis=0) - 1.0).max() < 0.08


def test_training_goes_on_from_a_model_with_a_light():
    """On its mean colours; a light is known again once it is looked for."""
    sequence, learnt = filmed_pillar()[2], trained_pillar()
    again = train(sequence, preset=PRESET, iterations=30, start=learnt, clock=ticking())
    assert isinstance(again, SplatModel)
    assert again.light is None
    before, after = (_over_black(model, sequence.train, 0) for model in (learnt, again))
    assert psnr(after, before) > 22.0


def _over_black(model: SplatModel, source: FrameSource, frame: int) -> np.ndarray:
    picture = model.render(source.camera(frame), source.pose(frame))
    return np.clip(picture[..., :3], 0.0, 1.0)
