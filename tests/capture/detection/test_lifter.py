"""The lifting network: what runs it, what it may not depend on, and how it is taught."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL
from capture.detection.lifter import WEIGHTS_FILE, closed_form, inputs_of, lift
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from tests.capture.people import body, landmark_positions, up_is_down
from tools.build_lifter import Shard, learn, mirrored, read_shard
from tools.lifter_network import LifterNetwork, forward_kinematics, local_rotations
from tools.lifter_poses import random_pose

FOCAL_PX, SIZE_PX = 600.0, 512.0


def _shard(count: int, seed: int, flattened: float) -> Shard:
    """People in random poses, 4 m away, whose 3D landmarks are `flattened` in depth."""
    rng, person = np.random.default_rng(seed), body()
    poses = [random_pose(rng, person.skeleton) for _ in range(count)]
    points = np.stack([landmark_positions(person, pose) for pose in poses])
    world = up_is_down(points - points[:, 23:25].mean(axis=1, keepdims=True))
    away = world + np.array([0.0, 0.0, 4.0])
    angles = np.stack([pose.joint_angles for pose in poses])
    moved = person.skeleton.joint_transforms(angles, np.zeros((count, 3)))
    return {
        "pixels": FOCAL_PX * away[..., :2] / away[..., 2:],
        "world": world * [1.0, 1.0, flattened],
        "visibility": np.full(world.shape[:2], 0.9),
        "global_rotations": OPENCV_TO_OPENGL[:, None] * moved[..., :3, :3],
        "rest": np.repeat(person.skeleton.rest_joints[None], count, axis=0),
        "focal_px": np.full(count, FOCAL_PX),
    }


def _lifted(shard: Shard, lifter=lift, **changed) -> np.ndarray:
    given = {**shard, **changed}
    said = lifter(given["pixels"], given["world"], given["visibility"], FOCAL_PX, np.zeros(2))
    return said.rotations


def _turned_deg(one: np.ndarray, other: np.ndarray) -> float:
    between = np.swapaxes(one, -1, -2) @ other
    return float(np.degrees(np.linalg.norm(matrix_to_axis_angle(between), axis=-1)).mean())


def test_numpy_runs_the_network_that_torch_has_taught():
    shard = _shard(8, 1, 0.8)
    with np.load(WEIGHTS_FILE) as file:
        weights = {name: torch.tensor(file[name].astype(np.float32)) for name in file.files}
    network = LifterNetwork(weights["mean"], weights["deviation"]).eval()
    network.load_state_dict(weights)
    inputs = inputs_of(
        shard["pixels"], shard["world"], shard["visibility"], shard["focal_px"], np.zeros(2)
    )
    with torch.no_grad():
        rotations, log_spread = network(
            torch.tensor(inputs.features), torch.tensor(inputs.closed_form, dtype=torch.float32)
        )
    said = lift(shard["pixels"], shard["world"], shard["visibility"], FOCAL_PX, np.zeros(2))
    assert said.spread_rad == pytest.approx(np.exp(log_spread.numpy()), rel=1e-3)
    assert said.rotations[:, 1:] == pytest.approx(
        local_rotations(rotations).numpy()[:, 1:], abs=1e-3
    )


def test_where_in_the_picture_somebody_stands_changes_only_where_they_face():
    shard = _shard(6, 2, 0.8)
    turn = axis_angle_to_matrix(np.array([0.0, 0.3, 0.0]))
    rays = np.concatenate([shard["pixels"] / FOCAL_PX, np.ones((6, 33, 1))], axis=2) @ turn.T
    aside = _lifted(shard, pixels=FOCAL_PX * rays[..., :2] / rays[..., 2:])
    there = _lifted(shard)
    # the person is not a point: their middle moves a little with the perspective
    assert _turned_deg(aside[:, 1:], there[:, 1:]) < 1.0
    flipped = OPENCV_TO_OPENGL[:, None] * turn * OPENCV_TO_OPENGL
    assert _turned_deg(aside[:, 0], flipped @ there[:, 0]) < 1.5


def test_rotations_are_rotations_even_of_landmarks_in_one_place():
    nowhere = np.zeros((2, 33, 2)), np.zeros((2, 33, 3)), np.zeros((2, 33))
    said = lift(*nowhere, FOCAL_PX, np.zeros(2))
    product = said.rotations @ np.swapaxes(said.rotations, -1, -2)
    assert product == pytest.approx(np.broadcast_to(np.eye(3), product.shape), abs=1e-6)
    assert np.isfinite(said.spread_rad).all()


def test_the_closed_form_is_believed_of_other_estimators():
    shard = _shard(4, 3, 1.0)
    truth = local_rotations(torch.tensor(shard["global_rotations"])).numpy()
    pelvis = OPENCV_TO_OPENGL[:, None] * shard["global_rotations"][:, 0]
    said = _lifted(shard, closed_form)
    assert _turned_deg(said[:, 0], pelvis) < 10.0
    knee = 4
    assert _turned_deg(said[:, knee], truth[:, knee]) < 15.0


def test_a_mirror_seen_in_a_mirror_is_the_thing_itself():
    shard = _shard(3, 4, 0.8)
    twice = mirrored(mirrored(shard))
    for name, value in shard.items():
        assert twice[name] == pytest.approx(value, abs=1e-6)


def test_a_shard_of_the_version_that_said_turns_is_read(tmp_path):
    shard = _shard(2, 7, 1.0)
    rotations = shard["global_rotations"]
    older = {name: value for name, value in shard.items() if name != "global_rotations"}
    np.savez(tmp_path / "old.npz", allow_pickle=False, turns=rotations, **older)
    np.savez(tmp_path / "new.npz", allow_pickle=False, **shard)
    for name in ("old", "new"):
        read = read_shard(tmp_path / f"{name}.npz")
        assert set(read) == set(shard)
        np.testing.assert_array_equal(read["global_rotations"], rotations)


def test_what_flattens_people_is_learnt():
    taught, asked = _shard(512, 5, 0.5), _shard(64, 6, 0.5)
    network = learn(taught, epochs=40)
    inputs = inputs_of(
        asked["pixels"], asked["world"], asked["visibility"], asked["focal_px"], np.zeros(2)
    )
    closed = torch.tensor(inputs.closed_form, dtype=torch.float32)
    with torch.no_grad():
        predicted, _ = network(torch.tensor(inputs.features), closed)
    truth = torch.tensor(
        (OPENCV_TO_OPENGL[:, None] * inputs.view)[:, None] @ asked["global_rotations"],
        dtype=torch.float32,
    )
    rest = torch.tensor(asked["rest"], dtype=torch.float32)
    places = forward_kinematics(truth, rest)
    off = [
        float((forward_kinematics(world, rest) - places).norm(dim=-1).mean())
        for world in (predicted, closed)
    ]
    assert off[0] < 0.7 * off[1]
