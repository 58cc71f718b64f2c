"""How many passes a training has, and that pictures are compared like with like."""

from __future__ import annotations

import numpy as np

from renderer.pose_refinement.clip_poses import PoseRefinement
from renderer.pose_refinement.passes import RefinementPasses
from renderer.pose_refinement.photometry import SkinnedPoints
from renderer.splats.expressions import ClipBlendShapes, no_offsets, no_splats
from renderer.splats.training.views import read_views
from scene.sequence import PoseTrust
from tests.renderer.studio import make_model, make_sequence


def passes_of(steps: int) -> list[float]:
    """Fractions of a training of `steps` at which passes are made."""
    passes = RefinementPasses(read_views(make_sequence(trust=PoseTrust.ESTIMATED).train))
    return [step / steps for step in range(steps) if passes.should_run(step / steps)]


def test_longer_trainings_have_more_passes_up_to_a_bound():
    counts = [len(passes_of(steps)) for steps in (30, 60, 120, 2000)]
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[0] < counts[1] < counts[3] <= 10


def test_passes_leave_the_beginning_and_the_end_alone():
    fractions = passes_of(2000)
    assert fractions[0] > 0.1
    assert fractions[-1] <= 0.8


def test_the_count_goes_on_after_a_restart():
    views = read_views(make_sequence(trust=PoseTrust.ESTIMATED).train)
    first, second = RefinementPasses(views), RefinementPasses(views)
    for step in range(100):
        first.should_run(step / 400)
    second.restore(first.state())
    rest = [[p.should_run(step / 400) for step in range(100, 400)] for p in (first, second)]
    assert rest[0] == rest[1]
    assert any(rest[0])


def test_the_true_splats_in_true_poses_ask_for_nothing():
    """A model of pictures that it drew itself: what is left is the pictures' 8 bits."""
    sequence, model = make_sequence(trust=PoseTrust.ESTIMATED), make_model()
    passes, poses = RefinementPasses(read_views(sequence.train)), PoseRefinement(sequence)
    points = SkinnedPoints(model.parameters[:, :3], model.joints.astype(np.uint16), model.weights)
    still = ClipBlendShapes(no_splats(), no_offsets(), sequence.motion.expressions)
    asked = passes.equations(points, model.parameters, poses, 0.1, still)
    step = np.linalg.solve(asked.matrices[0] + np.eye(len(asked.matrices[0])), asked.vectors[0])
    assert asked.difference < 1e-4
    assert np.abs(step).max() < 2e-3
