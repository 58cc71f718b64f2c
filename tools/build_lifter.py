"""Makes `capture/assets/lifter.npz`: `python -m tools.build_lifter POSE_MODEL FOLDER PERFORMERS`.

Studio performers in random poses are rendered and given to the estimator; its landmarks and the
true poses are kept in FOLDER, a file a performer, so that an interrupted run continues. Then the
network of `capture.detection.lifter` is trained on them. Named performers and recorded motion are
not part of its training data."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import torch

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL
from capture.body.landmarks import MIRROR
from capture.detection.landmarks import Landmarks, MediaPipeEstimator
from capture.detection.lifter import WEIGHTS_FILE, Inputs, inputs_of
from capture.studio.performer import make_performer, render_performer
from capture.studio.room import room_background
from scene.arrays import Array, Float, Tensor
from scene.camera import Camera, orbit_camera
from scene.skeleton import JOINT_NAMES
from tools.lifter_network import LifterNetwork, forward_kinematics, local_rotations
from tools.lifter_poses import random_pose

FIRST_SEED = 5000
"""Performers; named performers, demo and benchmarks use smaller numbers."""
_POSES, _POSES_A_CAMERA = 100, 20
_SIZE_PX = 448
_UPPER_BODIES = 0.12
"""Share of cameras that see no legs, as webcams do."""
_EPOCHS, _BATCH, _RATE, _WEIGHT_DECAY = 40, 256, 1e-3, 0.02
_WARM_UP_STEPS = 200
_JOINT_WEIGHT, _GLOBAL_ROTATION_WEIGHT, _SPREAD_WEIGHT = 8.0, 0.5, 0.1
"""Relative to an error of 1 rad in a joint's local rotation: 1 m of position, 1 rad of global
rotation, and the likelihood of its spread."""
_MIRROR_JOINTS = [
    JOINT_NAMES.index(name.replace("left", "#").replace("right", "left").replace("#", "right"))
    for name in JOINT_NAMES
]

Shard = dict[str, Float[Array, "*shape"]]
"""pixels [N 33 2], world [N 33 3], visibility [N 33], global_rotations [N 24 3 3] (rest to camera),
rest [N 24 3] m, focal_px [N]; the picture's centre is the origin of its pixels."""


def main() -> None:
    """Render what is missing, train, write."""
    pose_model, folder, performers = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    seeds = range(FIRST_SEED, FIRST_SEED + performers)
    render_missing(seeds, folder, pose_model)
    shards = [read_shard(folder / f"{seed}.npz") for seed in seeds]
    network = learn({name: np.concatenate([s[name] for s in shards]) for name in shards[0]})
    halves = {name: value.numpy().astype(np.float16) for name, value in network.exported().items()}
    np.savez_compressed(WEIGHTS_FILE, allow_pickle=False, **halves)


def read_shard(path: Path) -> Shard:
    """A stored shard, also of a version that called the global rotations `turns`."""
    shard = dict(np.load(path))
    if "turns" in shard:
        shard["global_rotations"] = shard.pop("turns")
    return shard


def render_missing(seeds: Iterable[int], folder: Path, pose_model: Path) -> None:
    """Render the performers `seeds` that `folder` does not hold yet."""
    folder.mkdir(parents=True, exist_ok=True)
    with MediaPipeEstimator(pose_model) as estimator:
        for seed in seeds:
            shard = folder / f"{seed}.npz"
            if not shard.exists():
                building = folder / f"{seed}.part.npz"
                np.savez(building, allow_pickle=False, **_render(seed, estimator))
                building.rename(shard)
                print(f"performer {seed}", flush=True)


def _render(seed: int, estimator: MediaPipeEstimator) -> Shard:
    """One performer in random poses, a few cameras."""
    rng = np.random.default_rng([seed, 0x11F7])
    performer, rows = make_performer(seed), []
    skeleton = performer.body.skeleton
    look = "lit" if seed % 2 else "plain"
    for number in range(_POSES):
        if number % _POSES_A_CAMERA == 0:
            camera = _random_camera(rng)
            room = room_background(camera, seed)
        pose = random_pose(rng, skeleton)
        image, alpha = render_performer(performer, pose, camera, look, supersampling=1)
        people = estimator.detect(_as_recorded(rng, image + (1.0 - alpha[..., None]) * room))
        if not people:
            continue
        found: Landmarks = max(people, key=lambda person: float(person.mask.sum()))
        transforms = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)
        rows.append(
            {
                "pixels": found.pixels - 0.5 * _SIZE_PX,
                "world": found.world,
                "visibility": found.visibility,
                "global_rotations": camera.rotation @ transforms[:, :3, :3],
                "rest": skeleton.rest_joints,
                "focal_px": np.array(camera.focal_px),
            }
        )
    return {name: np.stack([row[name] for row in rows]).astype(np.float32) for name in rows[0]}


def _random_camera(rng: np.random.Generator) -> Camera:
    """In front of the person, at a webcam's or a phone's distance, rarely level or centred."""
    if rng.uniform() < _UPPER_BODIES:
        target, distance = (rng.normal(0.0, 0.12), rng.uniform(1.0, 1.35)), rng.uniform(1.1, 2.2)
        field = rng.uniform(0.6, 0.9)
    else:
        target, distance = (rng.normal(0.0, 0.2), rng.uniform(0.75, 1.05)), rng.uniform(2.2, 5.5)
        field = 2.0 * np.arctan(rng.uniform(1.0, 1.7) / distance)
    elevation = rng.uniform(-0.15, 0.35)
    return orbit_camera((*target, 0.0), distance, 0.0, elevation, _SIZE_PX, _SIZE_PX, float(field))


def _as_recorded(rng: np.random.Generator, picture: Array) -> Array:
    """With random blur and sensor noise."""
    if rng.uniform() < 0.5:
        picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 1.4))
    levels = 255.0 * picture + rng.normal(0.0, rng.uniform(0.0, 6.0), picture.shape)
    return np.clip(levels + 0.5, 0.0, 255.0).astype(np.uint8)


def mirrored(shard: Shard) -> Shard:
    """The same people seen in a mirror: left is right."""
    flip = np.diag([-1.0, 1.0, 1.0]).astype(np.float32)
    landmarks = list(MIRROR)
    return {
        "pixels": shard["pixels"][:, landmarks] * flip.diagonal()[:2],
        "world": shard["world"][:, landmarks] * flip.diagonal(),
        "visibility": shard["visibility"][:, landmarks],
        "global_rotations": flip @ shard["global_rotations"][:, _MIRROR_JOINTS] @ flip,
        "rest": shard["rest"][:, _MIRROR_JOINTS] * flip.diagonal(),
        "focal_px": shard["focal_px"],
    }


def learn(shard: Shard, epochs: int = _EPOCHS) -> LifterNetwork:
    """The network trained on `shard` and its mirror image. Deterministic."""
    torch.manual_seed(0)
    both = {name: np.concatenate([shard[name], other]) for name, other in mirrored(shard).items()}
    features, closed_form, truth, rest = _tensors(both)
    network = LifterNetwork(features.mean(0), features.std(0) + 1e-3)
    adam = torch.optim.AdamW(network.parameters(), lr=_RATE, weight_decay=_WEIGHT_DECAY)
    total, step = epochs * (len(features) // _BATCH), 0
    warm_up = min(_WARM_UP_STEPS, max(total // 4, 1))
    for epoch in range(epochs):
        for chosen in torch.randperm(len(features))[: total // epochs * _BATCH].split(_BATCH):
            fade = 0.5 * (1.0 + np.cos(np.pi * step / total)) + 0.01
            adam.param_groups[0]["lr"] = _RATE * fade * min(1.0, step / warm_up)
            rotations, log_spread = network(features[chosen], closed_form[chosen])
            loss = _loss(rotations, log_spread, truth[chosen], rest[chosen])
            adam.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            adam.step()
            step += 1
        print(f"epoch {epoch + 1} of {epochs}: {loss.item():.4f}", flush=True)
    return network.eval()


def _tensors(shard: Shard) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Features, closed form, true rotations in the view through the person (y up), rest joints."""
    inputs: Inputs = inputs_of(
        shard["pixels"], shard["world"], shard["visibility"], shard["focal_px"], np.zeros(2)
    )
    truth = (OPENCV_TO_OPENGL[:, None] * inputs.view)[:, None] @ shard["global_rotations"]
    parts = (inputs.features, inputs.closed_form, truth, shard["rest"])
    features, closed_form, rotations, rest = (torch.tensor(p, dtype=torch.float32) for p in parts)
    return features, closed_form, rotations, rest


def _loss(rotations: Tensor, log_spread: Tensor, truth: Tensor, rest: Tensor) -> Tensor:
    """Of global rotations [N 24 3 3]: local and global rotations, joint positions and the
    spread."""
    local_error = (local_rotations(rotations) - local_rotations(truth)).square().sum((-1, -2))
    world = (rotations - truth).square().sum((-1, -2))
    position_error = forward_kinematics(rotations, rest) - forward_kinematics(truth, rest)
    # half of the squared Frobenius norm is the squared angle, where that is small
    likelihood = log_spread + 0.25 * local_error.detach() * torch.exp(-2.0 * log_spread)
    return (
        (local_error + 1e-4).sqrt().mean()
        + _GLOBAL_ROTATION_WEIGHT * (world + 1e-4).sqrt().mean()
        + _JOINT_WEIGHT * position_error.norm(dim=-1).mean()
        + _SPREAD_WEIGHT * likelihood.mean()
    )


if __name__ == "__main__":
    main()
