"""Training that goes on from an earlier model: nothing learnt is lost, on another body neither."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import TrainingError
from renderer.evaluation.evaluate import evaluate
from renderer.pose_refinement.clip_poses import PoseRefinement
from renderer.splats.layout import COLOUR
from renderer.splats.model import SplatModel
from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import first_splats, splats_of_model
from renderer.training import train
from scene import Sequence, Skeleton
from scene.sequence import PoseTrust
from tests.renderer.clocks import ticking
from tests.renderer.studio import make_model, make_motion, make_sequence


def accuracy(model: SplatModel, sequence: Sequence) -> float:
    figure = evaluate(model, sequence)["psnr"]["training_view"]["body_crop"]
    assert figure is not None
    return figure


def trained(sequence: Sequence, iterations: int, start: SplatModel | None = None) -> SplatModel:
    model = train(sequence, iterations=iterations, start=start, clock=ticking())
    assert isinstance(model, SplatModel)
    return model


def test_a_few_more_steps_are_worth_those_of_before_too():
    sequence = make_sequence()
    before, cold = trained(sequence, 200), trained(sequence, 60)
    warm = trained(sequence, 60, start=before)
    assert accuracy(warm, sequence) > accuracy(before, sequence)
    assert accuracy(warm, sequence) > accuracy(cold, sequence) + 1.0


def test_splats_follow_bones_that_are_longer_now():
    """All of them for the part of the body that is bound to the joint which has moved."""
    model, sequence = make_model(), make_sequence()
    rest = model.skeleton.rest_joints.copy()
    rest[9] += [0.0, 0.1, 0.0]
    longer = Skeleton(rest)
    first = first_splats(
        sequence, replace(SplatSettings(), count=300, most=300), np.random.default_rng(0)
    )
    moved = splats_of_model(model, first, longer)
    shift = moved.parameters[:, :3] - model.parameters[:, :3]
    bound = (model.weights * (model.joints == 9)).sum(axis=1)
    np.testing.assert_allclose(shift[:, 1], 0.1 * bound, atol=1e-6)
    np.testing.assert_array_equal(moved.parameters[:, 3:], model.parameters[:, 3:])
    np.testing.assert_allclose(np.linalg.norm(moved.normals, axis=1), 1.0, atol=1e-5)


def test_what_no_frame_showed_begins_anew_in_the_colours_that_it_had():
    model, sequence = make_model(), make_sequence()
    seen = model.parameters[:, 0] > 0.0
    first = first_splats(
        sequence, replace(SplatSettings(), count=300, most=300), np.random.default_rng(0)
    )
    begun = splats_of_model(replace(model, seen=seen), first, model.skeleton)
    kept, anew = begun.parameters[: seen.sum()], begun.parameters[seen.sum() :]
    np.testing.assert_array_equal(kept, model.parameters[seen])
    places = {tuple(place) for place in first.parameters[:, :3].tolist()}
    assert 100 < len(anew) < 200
    assert all(tuple(place) in places for place in anew[:, :3].tolist())
    of_the_model = {tuple(colour) for colour in model.parameters[:, COLOUR : COLOUR + 3].tolist()}
    assert {tuple(colour) for colour in anew[:, COLOUR : COLOUR + 3].tolist()} <= of_the_model


def test_refined_poses_are_gone_on_from_for_the_same_clip_alone():
    sequence = make_sequence(trust=PoseTrust.ESTIMATED)
    refined = make_motion(6)
    refined.joint_angles[:, 9, 0] += 0.1
    known = replace(make_model(), motion=refined, data_hash=sequence.data_hash)
    again = PoseRefinement(sequence, known)
    np.testing.assert_array_equal(again.motion().joint_angles, refined.joint_angles)
    assert np.abs(again.state()["pose_shared"]).max() < 1e-9
    anew = PoseRefinement(sequence, replace(known, data_hash="of another clip"))
    np.testing.assert_array_equal(anew.motion().joint_angles, sequence.motion.joint_angles)


def test_a_field_starts_from_nothing():
    with pytest.raises(TrainingError, match="start must be a model of splats"):
        train(make_sequence(), preset="fast", iterations=1, start=make_model(), clock=ticking())
