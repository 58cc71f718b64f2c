"""Expressions move splats at rest: in pictures, files and training, as the plain twin says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

import renderer.reference.splats as twin
from renderer.devices import best_device
from renderer.evaluation.metrics import psnr
from renderer.model_files import load_model, save_model
from renderer.presets import find_preset
from renderer.scene_renderer import SceneRenderer
from renderer.splats.expressions import ClipBlendShapes
from renderer.splats.files.viewer_file import RECORD, encode
from renderer.splats.layout import BOX_FILTER_PX2, POSITION
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.gpu import GpuSplatRenderer
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.rasteriser.workspace import pack_camera
from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import first_splats, splats_of_model
from renderer.training import train
from scene import (
    EXPRESSION_COUNT,
    Body,
    Environment,
    InvalidInput,
    Lighting,
    Performer,
    Pose,
    Scene,
    Sequence,
    orbit_camera,
)
from scene.expression import BLEND_SHAPE_COUNT, blend_shape_weights, neutral
from tests.renderer.splats.rasteriser.test_rasteriser import dense_weights, make_camera, make_scene
from tests.renderer.splats.viewer_file import decode
from tests.renderer.studio import DrawnFrames, make_body, make_model, make_motion, make_sequence

SHOWN = np.array(
    [0.6, 0.0, 1.0, 0.2, 0.0, 0.4, 0.0, *[0.5, 0.9, 0.0, 0.3, 0.0], *[0.0, 1.0, 0.0, 0.7, 0.1]]
)


def expressive(model: SplatModel, count: int = 30, far_m: float = 0.1) -> SplatModel:
    """`model` with offsets for its first `count` splats."""
    offsets = np.random.default_rng(7).uniform(-far_m, far_m, (count, BLEND_SHAPE_COUNT, 3))
    return replace(
        model,
        expression_splats=np.arange(count, dtype=np.int32) * 2,
        expression_offsets=offsets.astype(np.float32),
    )


@pytest.fixture(scope="module")
def person() -> tuple[SplatModel, np.ndarray]:
    parameters, joints, weights, turned = make_scene(80, 3)
    model = replace(
        make_model(80), parameters=parameters, joints=joints.astype(np.uint8), weights=weights
    )
    transforms = np.tile(np.eye(4, dtype=np.float32), (24, 1, 1))
    transforms[: len(turned)] = turned
    return expressive(model), transforms


def test_pictures_are_those_of_the_plain_twin(person):
    model, transforms = person
    camera = make_camera(64, 48)
    packed = torch.tensor(pack_camera(camera).astype(np.float64))
    leaf = twin.expressed(
        torch.tensor(model.parameters.astype(np.float64)),
        torch.tensor(model.expression_splats.astype(np.int64)),
        torch.tensor(model.expression_offsets.astype(np.float64)),
        torch.tensor(blend_shape_weights(SHOWN)),
    )
    slow = twin.draw(
        leaf,
        dense_weights(model.weights),
        torch.tensor(transforms[:3].astype(np.float64)),
        packed,
        64,
        48,
        BOX_FILTER_PX2,
    ).numpy()
    fast = SplatRenderer([model]).render(camera, [transforms], expressions=[SHOWN])
    assert np.abs(fast - slow).max() < 0.012
    at_rest = SplatRenderer([model]).render(camera, [transforms])
    assert np.abs(fast - at_rest).max() > 0.2


def test_an_expression_leaves_no_trace_in_the_next_picture(person):
    model, transforms = person
    camera, renderer = make_camera(48, 48), SplatRenderer([model])
    light = Lighting(np.full((9, 3), 0.3), np.array([0.0, 1.0, 0.0]), np.array([0.5, 0.2, 0.1]))
    for lighting in (None, light):
        before = renderer.render(camera, [transforms], lighting).copy()
        shown = renderer.render(camera, [transforms], lighting, expressions=[SHOWN])
        assert np.abs(shown - before).max() > 0.1
        after = renderer.render(camera, [transforms], lighting, expressions=[neutral()])
        np.testing.assert_array_equal(after, before)


def test_everybody_shows_their_own(person):
    model, transforms = person
    away = transforms.copy()
    away[:, 0, 3] += 0.7
    camera = make_camera(64, 48)
    both = SplatRenderer([model, model]).render(
        camera, [transforms, away], expressions=[SHOWN, neutral()]
    )
    moved = replace(
        model,
        parameters=ClipBlendShapes(
            model.expression_splats, model.expression_offsets, SHOWN[None]
        ).moved(model.parameters, 0),
    )
    expected = SplatRenderer([moved, model]).render(camera, [transforms, away])
    np.testing.assert_allclose(both, expected, atol=1e-5)


def test_a_gpu_draws_them_too(person):
    model, transforms = person
    other = make_model(20)
    camera = make_camera(32, 32)
    cpu = SplatRenderer([other, model])
    gpu = GpuSplatRenderer([other, model], best_device())
    moved = [transforms, transforms]
    for shown in ([neutral(), SHOWN], None):
        expected = cpu.render(camera, moved, expressions=shown)
        np.testing.assert_allclose(
            gpu.render(camera, moved, expressions=shown), expected, atol=2e-3
        )
        depth = cpu.geometry(moved).depth
        np.testing.assert_allclose(gpu.geometry(moved).depth, depth, atol=2e-3)


def test_the_stage_and_a_model_draw_what_the_pose_shows():
    model = expressive(make_model(), 200, 0.3)
    camera = orbit_camera((0.0, 0.8, 0.0), 3.4, 0.0, 0.1, 48, 48)
    shown = replace(Pose.rest(), expression=SHOWN)
    assert np.abs(model.render(camera, shown) - model.render(camera, Pose.rest())).max() > 0.1

    def staged(pose: Pose) -> np.ndarray:
        somebody = Performer("one", model, np.zeros(3), 0.0, pose)
        return SceneRenderer().render(Scene(Environment(), (somebody,)), camera).astype(int).copy()

    assert np.abs(staged(shown) - staged(Pose.rest())).max() > 25


def test_model_files_keep_them(tmp_path):
    model = expressive(make_model())
    save_model(model, tmp_path / "m.safetensors")
    again = load_model(tmp_path / "m.safetensors")
    assert isinstance(again, SplatModel)
    np.testing.assert_array_equal(again.expression_splats, model.expression_splats)
    np.testing.assert_allclose(again.expression_offsets, model.expression_offsets, atol=1e-4)
    save_model(make_model(), tmp_path / "none.safetensors")
    plain = load_model(tmp_path / "none.safetensors")
    assert isinstance(plain, SplatModel)
    assert not len(plain.expression_splats)


def test_viewer_files_keep_them_in_file_order():
    model = expressive(make_model())
    data = encode(model)
    assert len(data) == len(encode(make_model())) + 7 * 30 * BLEND_SHAPE_COUNT
    assert RECORD.itemsize == 32
    whole = decode(data, model)
    assert (np.diff(whole.expression_splats) > 0).all()
    step = np.abs(model.expression_offsets).max(axis=(0, 2))[:, None] / 127.0
    places = model.parameters[:, POSITION : POSITION + 3]
    for splat, offsets in zip(whole.expression_splats, whole.expression_offsets, strict=True):
        # which splat it was, by where it lies
        near = np.abs(places - whole.parameters[splat, POSITION : POSITION + 3]).sum(axis=1)
        row = int(np.flatnonzero(model.expression_splats == near.argmin())[0])
        assert (np.abs(offsets - model.expression_offsets[row]) < 0.51 * step).all()


def test_a_model_without_expressions_has_an_empty_section():
    model = make_model()
    again = decode(encode(model), model)
    assert not len(again.expression_splats)


@pytest.mark.usefixtures("unchecked_annotations")
def test_splats_that_are_none_are_refused():
    offsets = np.zeros((1, BLEND_SHAPE_COUNT, 3), np.float32)
    with pytest.raises(InvalidInput, match=r"must be from 0 to below 600; got 600 to 600"):
        replace(make_model(), expression_splats=np.array([600]), expression_offsets=offsets)
    with pytest.raises(InvalidInput, match=r"expression_offsets must be 0 x 27 x 3; got 1 x 27"):
        replace(make_model(), expression_offsets=offsets)


def nodding_body() -> Body:
    """The box whose top moves to the left by its first expression."""
    body = make_body()
    assert body.rest_vertices is not None
    directions = np.zeros((BLEND_SHAPE_COUNT, len(body.rest_vertices), 3))
    directions[0, body.rest_vertices[:, 1] > 1.0, 0] = 0.25
    return replace(body, expression_directions=directions)


def test_offsets_begin_as_the_surface_moves():
    sequence = replace(make_sequence(), body=nodding_body())
    settings = SplatSettings(count=500, most=500, expressive_density=1.0)
    first = first_splats(sequence, settings, np.random.default_rng(0))
    height = first.parameters[first.expression_splats, 1]
    assert height.min() > 0.75
    share = np.clip((height - 0.8) / 0.8, 0.0, 1.0)  # linear from the middle to the top
    np.testing.assert_allclose(first.expression_offsets[:, 0, 0], 0.25 * share, atol=5e-3)
    assert not first.expression_offsets[:, 1:].any()


def test_denser_splats_are_smaller_and_share_the_count():
    sequence = replace(make_sequence(), body=nodding_body())
    made = [
        first_splats(
            sequence,
            SplatSettings(count=900, most=900, expressive_density=d),
            np.random.default_rng(0),
        )
        for d in (1.0, 3.0)
    ]
    sizes = [np.exp(first.parameters[:, 3]) for first in made]
    tops = [first.parameters[:, 1] > 0.8 for first in made]
    assert len(sizes[0]) == len(sizes[1]) == 900
    assert tops[1].mean() == pytest.approx(0.75, abs=0.03)
    upper, lower = np.median(sizes[1][tops[1]]), np.median(sizes[1][~tops[1]])
    assert lower / upper == pytest.approx(np.sqrt(3.0), rel=0.01)
    assert np.ptp(sizes[0]) < 1e-6


def test_a_warm_start_keeps_offsets_and_an_older_model_gets_them():
    sequence = replace(make_sequence(), body=nodding_body())
    first = first_splats(sequence, SplatSettings(count=400, most=400), np.random.default_rng(0))
    known = splats_of_model(expressive(make_model()), first, sequence.body.skeleton)
    assert len(known.expression_splats) == 30
    without_in_betweens = expressive(make_model())
    without_in_betweens.expression_offsets[:, EXPRESSION_COUNT:] = 0.0
    for model in (make_model(), without_in_betweens):
        older = splats_of_model(model, first, sequence.body.skeleton)
        top = older.parameters[:, 1] > 1.0
        assert np.isin(np.flatnonzero(top), older.expression_splats).mean() > 0.98


def leaning() -> Sequence:
    """The box filmed while its first expression comes and goes, as its body moves the drawn."""
    body, motion = nodding_body(), make_motion(12)
    drawn = make_model(1500)
    height = drawn.parameters[:, 1].astype(np.float64)
    offsets = np.zeros((1500, BLEND_SHAPE_COUNT, 3), np.float32)
    offsets[:, 0, 0] = 0.25 * np.clip((height - 0.8) / 0.8, 0.0, 1.0)
    truth = replace(
        drawn, expression_splats=np.arange(1500, dtype=np.int32), expression_offsets=offsets
    )
    expressions = np.zeros((12, EXPRESSION_COUNT))
    expressions[:, 0] = np.arange(12) % 4 / 3.0
    motion = replace(motion, expressions=expressions)
    return replace(
        make_sequence(frames=12), body=body, motion=motion, train=DrawnFrames(truth, motion)
    )


def test_training_sees_each_frame_as_its_expression_moves_it():
    sequence = leaning()
    preset = find_preset("splats")
    small = replace(preset, settings=replace(preset.settings, count=1500))
    clock = iter(np.arange(1e6)).__next__
    knows = train(sequence, preset=small, iterations=200, clock=clock)
    without = replace(sequence, body=replace(sequence.body, expression_directions=None))
    ignores = train(without, preset=small, iterations=200, clock=clock)
    assert isinstance(knows, SplatModel)
    assert len(knows.expression_splats) > 300

    def worth(model) -> float:
        frames = sequence.train
        return float(
            np.mean(
                [
                    psnr(model.render(frames.camera(i), frames.pose(i))[..., :3], frames.image(i))
                    for i in range(12)
                ]
            )
        )

    assert worth(knows) > worth(ignores) + 2.0
