"""The shipped body model: T-pose, weights, shape numbers."""

from __future__ import annotations

import numpy as np
import pytest

from capture.body.model import SHAPE_NAMES, load_body_model, require_height
from scene import JOINT_NAMES, InvalidInput
from tests.capture.sequences import surface

SIDES = (("left", 1.0), ("right", -1.0))


def mean_body():
    return load_body_model().body(np.zeros(len(SHAPE_NAMES)))


def bone(skeleton, start: str, end: str) -> np.ndarray:
    """Unit vector from joint `start` to joint `end` at rest."""
    joints = skeleton.rest_joints
    way = joints[JOINT_NAMES.index(end)] - joints[JOINT_NAMES.index(start)]
    return way / np.linalg.norm(way)


@pytest.mark.parametrize(("side", "out"), SIDES)
def test_rest_is_the_t_pose(side, out):
    skeleton = mean_body().skeleton
    for start, end in (("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "hand")):
        np.testing.assert_allclose(
            bone(skeleton, f"{side}_{start}", f"{side}_{end}"), [out, 0, 0], atol=1e-4
        )
    for start, end in (("hip", "knee"), ("knee", "ankle")):
        np.testing.assert_allclose(
            bone(skeleton, f"{side}_{start}", f"{side}_{end}"), [0, -1, 0], atol=1e-4
        )
    assert bone(skeleton, f"{side}_ankle", f"{side}_foot")[2] > 0.9  # toes forward, +z


@pytest.mark.parametrize("shape", [np.zeros(5), [0.1, -0.2, 0.4, 0.2, -0.2], [-0.4] * 5])
def test_every_body_stands_on_the_floor_at_the_origin(shape):
    body = load_body_model().body(np.array(shape))
    vertices, _, _ = surface(body)
    assert vertices[:, 1].min() == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(body.skeleton.rest_joints[0, [0, 2]], 0.0, atol=1e-6)
    assert 1.3 < np.ptp(vertices[:, 1]) < 2.1


def test_blend_weights_sum_to_one_with_at_most_four_joints_a_vertex():
    weights = load_body_model().blend_weights
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    assert weights.min() >= 0.0
    assert (weights > 0.0).sum(axis=1).max() <= 4
    # every joint moves something; collars least, blended with spine and upper arm everywhere
    assert (weights.max(axis=0) > 0.4).all()


def test_faces_look_outwards():
    vertices, faces, _ = surface(mean_body())
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    litres = 1e3 * np.einsum("tx,tx->", a, np.cross(b, c)) / 6.0
    assert 45.0 < litres < 110.0  # signed: inside-out faces would make it negative


def test_body_is_symmetric():
    joints = mean_body().skeleton.rest_joints
    for index, name in enumerate(JOINT_NAMES):
        if name.startswith("left_"):
            mirrored = joints[JOINT_NAMES.index(name.replace("left", "right"))] * [-1, 1, 1]
            np.testing.assert_allclose(joints[index], mirrored, atol=2e-3)


def test_shape_is_linear_but_for_the_floor():
    model = load_body_model()
    shape = np.array([0.1, -0.2, 0.3, 0.05, -0.1])
    once, twice = (model.body(k * shape).skeleton.rest_joints for k in (1.0, 2.0))
    zero = model.body(0.0 * shape).skeleton.rest_joints
    change = (twice - zero) - 2.0 * (once - zero)
    np.testing.assert_allclose(change[:, [0, 2]], 0.0, atol=1e-9)
    np.testing.assert_allclose(change[:, 1], change[0, 1], atol=1e-9)  # the floor moves all alike


def test_shape_numbers_do_what_their_names_say():
    model = load_body_model()

    def extents(name: str, amount: float) -> tuple[float, float]:
        vertices, _, _ = surface(model.body(amount * np.eye(5)[SHAPE_NAMES.index(name)]))
        waist = np.abs(vertices[:, 1] - 0.6 * vertices[:, 1].max()) < 0.03
        trunk = waist & (np.abs(vertices[:, 0]) < 0.3)
        return float(vertices[:, 1].max()), float(np.ptp(vertices[trunk, 2]))

    assert extents("height", 0.2)[0] > extents("height", -0.2)[0] + 0.05
    assert extents("weight", 0.3)[1] > extents("weight", -0.3)[1] + 0.01


def test_scale_sizes_joints_and_surface_alike():
    model = load_body_model()
    one, double = model.body(np.zeros(5)), model.body(np.zeros(5), scale=2.0)
    np.testing.assert_allclose(surface(double)[0], 2.0 * surface(one)[0], atol=1e-12)
    np.testing.assert_allclose(
        double.skeleton.rest_joints, 2.0 * one.skeleton.rest_joints, atol=1e-12
    )


@pytest.mark.usefixtures("unchecked_annotations")
def test_wrong_number_of_shape_numbers_is_refused():
    with pytest.raises(InvalidInput, match="shape must be 5; got 3"):
        load_body_model().body(np.zeros(3))


def test_a_height_is_refused_where_nobody_is_as_tall():
    require_height(0.5)
    require_height(2.5)
    for height_m in (0.49, 178.0, float("nan")):
        with pytest.raises(InvalidInput, match=r"metres between 0\.5 and 2\.5; got"):
            require_height(height_m)
