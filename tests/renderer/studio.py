"""A tiny exact sequence without any file: four views of a coloured body, drawn by splats."""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, PARAMETERS, ROTATION
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.training.initialisation import sample_surface
from scene import Body, Motion, Pose, Sequence, Skeleton, orbit_camera
from scene.sequence import PoseTrust
from scene.skeleton import JOINT_COUNT, PARENTS

SIZE = 48


def make_body() -> Body:
    """A box of a body: 24 joints up its middle, the upper half moved by joint 9, the rest by 0."""
    joints = np.zeros((JOINT_COUNT, 3))
    joints[:, 1] = 0.5
    for joint in range(1, JOINT_COUNT):
        joints[joint, 1] = joints[PARENTS[joint], 1] + 0.08
    corners = np.array(
        [[x, y, z] for x in (-0.2, 0.2) for y in (0.0, 0.8, 1.6) for z in (-0.1, 0.1)]
    )
    quads = [(0, 1, 3, 2), (2, 3, 5, 4), (6, 8, 9, 7), (8, 10, 11, 9), (0, 2, 8, 6), (2, 4, 10, 8),
             (1, 7, 9, 3), (3, 9, 11, 5), (0, 6, 7, 1), (4, 5, 11, 10)]  # fmt: skip
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    weights = np.zeros((12, JOINT_COUNT))
    weights[np.arange(12), np.where(corners[:, 1] > 0.9, 9, 0)] = 1.0
    return Body(Skeleton(joints), corners, faces, weights)


def make_model(count: int = 600, seed: int = 0) -> SplatModel:
    """Splats on the box: red below, green above, blue at the back."""
    rng, body = np.random.default_rng(seed), make_body()
    points, _, weights, area = sample_surface(body, count, rng)
    parameters = np.zeros((count, PARAMETERS), np.float32)
    parameters[:, :3] = points
    parameters[:, LOG_SCALE : LOG_SCALE + 3] = np.log(0.6 * np.sqrt(area / count))
    parameters[:, ROTATION], parameters[:, OPACITY] = 1.0, 3.0
    parameters[:, COLOUR] = points[:, 1] < 0.8
    parameters[:, COLOUR + 1] = points[:, 1] >= 0.8
    parameters[:, COLOUR + 2] = points[:, 2] < 0.0
    joints = np.argsort(-weights, axis=1)[:, :4].astype(np.uint8)
    top = np.take_along_axis(weights, joints.astype(int), axis=1).astype(np.float32)
    motion = make_motion(4)
    seen = np.ones(count, bool)
    return SplatModel(parameters, joints, top, seen, body.skeleton, motion, "of a test")


def make_motion(frames: int) -> Motion:
    """Turning once, the upper half nodding."""
    poses = []
    for frame in range(frames):
        angles = np.zeros((JOINT_COUNT, 3))
        angles[0, 1] = 2.0 * np.pi * frame / frames
        angles[9, 0] = 0.2 * np.sin(frame)
        poses.append(Pose(angles, np.zeros(3), frame / 10.0))
    return Motion.from_poses(poses)


class DrawnFrames:
    """A `FrameSource` drawn by a model in `motion`, which claims to show `claimed`."""

    def __init__(self, model: SplatModel, motion: Motion, claimed: Motion | None = None) -> None:
        self._motion = claimed or motion
        self._camera = orbit_camera((0.0, 0.8, 0.0), 3.4, 0.0, 0.1, SIZE, SIZE)
        renderer = SplatRenderer((model,))
        self._pictures = [
            renderer.render(
                self._camera,
                [model.skeleton.skinning_transforms(p.joint_angles, p.root_translation)],
                expressions=[p.expression],
            ).copy()
            for p in (motion.pose(i) for i in range(len(motion)))
        ]

    def __len__(self) -> int:
        return len(self._motion)

    def camera(self, index: int):
        return self._camera

    def pose(self, index: int) -> Pose:
        return self._motion.pose(index)

    def image(self, index: int):
        return np.clip(self._pictures[index][..., :3], 0.0, 1.0)

    def mask(self, index: int):
        return self._pictures[index][..., 3]


def make_sequence(
    *, trust: PoseTrust = PoseTrust.EXACT, motion: Motion | None = None, frames: int = 6
) -> Sequence:
    """The box filmed by one camera; `motion` is what the sequence claims its poses to be."""
    true = make_motion(frames)
    source, claimed = DrawnFrames(make_model(), true, motion), motion or true
    return Sequence("a box", 10.0, make_body(), source, "of a test", claimed, {}, trust)
