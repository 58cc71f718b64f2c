"""Axes begin undisturbed, go on to more, and are named once."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stability.axes import FIELD_AXES, TRAINING_AXES
from benchmarks.stability.axis import TrainingAxis
from benchmarks.stability.captures import CAPTURE_AXES
from benchmarks.stability.live import LIVE_AXES
from benchmarks.stability.measure import AXES, QUICK_AXES
from scene.rotations import axis_angle_to_matrix
from tests.benchmarks.stability.people import subject

STILL = [axis for axis in TRAINING_AXES if not axis.filmed_anew]


def test_every_axis_has_a_name_of_its_own():
    assert len(AXES) == len(TRAINING_AXES) + len(CAPTURE_AXES) + len(LIVE_AXES)
    assert {*FIELD_AXES, *QUICK_AXES} <= set(AXES)


@pytest.mark.parametrize("axis", AXES.values(), ids=lambda axis: axis.name)
def test_steps_are_told_apart(axis):
    labels = [axis.label(step) for step in axis.steps]
    assert len(set(labels)) == len(axis.steps) >= 2


def test_chosen_steps_have_both_ends():
    axis = AXES["sensor_noise"]
    assert axis.chosen(2) == (axis.steps[0], axis.steps[-1])
    assert axis.chosen(3) == (axis.steps[0], axis.steps[2], axis.steps[-1])
    assert axis.chosen(99) == axis.steps


@pytest.mark.parametrize("axis", STILL, ids=lambda axis: axis.name)
def test_the_first_step_disturbs_nothing(axis: TrainingAxis):
    somebody = subject()
    before, after = somebody.material, axis.spoil(somebody, axis.steps[0], axis.rng())
    assert len(after.train) == len(before.train)
    for one, other in zip(before.train, after.train, strict=True):
        np.testing.assert_allclose(other.mask, one.mask, atol=1e-6)
        solid = (one.mask < 0.01) | (one.mask > 0.99)  # the room shines through a soft rim
        np.testing.assert_allclose(other.image[solid], one.image[solid], atol=0.02)
        turned = [axis_angle_to_matrix(pose.joint_angles) for pose in (one.pose, other.pose)]
        np.testing.assert_allclose(turned[1], turned[0], atol=1e-6)
        roots = [pose.root_translation for pose in (one.pose, other.pose)]
        np.testing.assert_allclose(roots[1], roots[0], atol=1e-9)


@pytest.mark.parametrize("axis", STILL, ids=lambda axis: axis.name)
def test_a_later_step_disturbs_something_and_again_the_same(axis: TrainingAxis):
    somebody = subject()
    once, again = (axis.spoil(somebody, axis.steps[-1], axis.rng()) for _ in range(2))
    assert (once.seed, once.precision) == (again.seed, again.precision)
    for one, other in zip(once.train, again.train, strict=True):
        np.testing.assert_array_equal(one.image, other.image)
    untouched = somebody.material
    of_training = (untouched.seed, untouched.precision)
    assert (once.seed, once.precision) != of_training or any(
        len(once.train) != len(untouched.train)
        or one.image.shape != other.image.shape
        or np.abs(one.image - other.image).max() > 0.01
        or np.abs(one.mask - other.mask).max() > 0.01
        or np.abs(one.pose.joint_angles - other.pose.joint_angles).max() > 0.01
        or np.abs(one.pose.root_translation - other.pose.root_translation).max() > 0.01
        for one, other in zip(once.train, untouched.train, strict=False)
    )
