"""A pillar of known albedo that turns in a known light, and what training makes of its frames."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from renderer.presets import Preset
from renderer.reference import shading as twin
from renderer.relighting.shading import normals_of
from renderer.splats.layout import COLOUR, OPACITY
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import first_splats
from renderer.training import train
from scene import Lighting, Motion, Pose, PoseTrust, Sequence, Skeleton, orbit_camera
from scene.body import Body
from scene.colour import to_srgb
from scene.skeleton import JOINT_COUNT
from tests.renderer.clocks import ticking
from tests.renderer.studio import DrawnFrames, make_sequence

FRAMES, SIZE = 16, 96
PRESET = Preset("splats", "of a test", SplatSettings(count=2500, most=2500))
FILMED_IN = Lighting(
    np.concatenate(
        [[[1.6, 1.6, 1.6], [0.35, 0.3, 0.25], [0.0, 0.1, 0.2], [0.5, 0.3, 0.1]], np.zeros((5, 3))]
    ),
    np.array([0.0, 1.0, 0.0]),
    np.zeros(3),
)
"""From +x and above, warmer from +x, bluer from +z."""


def pillar(sides: int = 24, rings: int = 12) -> Body:
    """A barrel that one joint moves: its normals point every way but straight up and down."""
    turn = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    heights = np.linspace(0.05, 1.55, rings)
    radii = 0.12 + 0.2 * np.sin(np.pi * heights / 1.6)
    ring = np.stack([np.sin(turn), np.zeros(sides), np.cos(turn)], axis=1)
    vertices = np.concatenate(
        [r * ring + [0.0, h, 0.0] for r, h in zip(radii, heights, strict=True)]
    )
    at = np.arange((rings - 1) * sides).reshape(-1, sides)
    right = np.roll(at, -1, axis=1)
    quads = np.stack([at, right, right + sides, at + sides], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    joints = np.zeros((JOINT_COUNT, 3))
    joints[:, 1] = np.linspace(0.5, 1.4, JOINT_COUNT)
    weights = np.zeros((len(vertices), JOINT_COUNT))
    weights[:, 0] = 1.0
    return Body(Skeleton(joints), vertices, faces, weights)


class LitFrames(DrawnFrames):
    """A `FrameSource`: splats of known albedo in a known light, turning before one camera."""

    def __init__(self, model: SplatModel, albedo: np.ndarray, lighting: Lighting) -> None:
        self._motion, self._pictures = model.motion, []
        self._camera = orbit_camera((0.0, 0.8, 0.0), 3.0, 0.0, 0.1, SIZE, SIZE)
        for frame in range(len(model.motion)):
            pose = model.motion.pose(frame)
            transforms = model.skeleton.skinning_transforms(
                pose.joint_angles, pose.root_translation
            )
            lit = model.parameters.copy()
            lit[:, COLOUR : COLOUR + 3] = twin.shade(
                albedo,
                model.parameters[:, :3],
                normals_of(model),
                model.joints,
                model.weights,
                transforms,
                self._camera.position,
                lighting,
            )
            seen = SplatRenderer((replace(model, parameters=lit),)).render(
                self._camera, [transforms]
            )
            self._pictures.append(seen.copy())

    def mask(self, index: int):
        return super().mask(index).round(2)


@cache
def filmed_pillar() -> tuple[SplatModel, np.ndarray, Sequence]:
    """A turning pillar in stripes, the albedo of its splats, and its frames."""
    body, poses = pillar(), []
    for frame in range(FRAMES):
        angles = np.zeros((JOINT_COUNT, 3))
        angles[0, 1] = 2.0 * np.pi * frame / FRAMES
        poses.append(Pose(angles, np.zeros(3), frame / 10.0))
    motion = Motion.from_poses(poses)
    sequence = replace(make_sequence(), pose_trust=PoseTrust.EXACT)
    settings = SplatSettings(count=2500, most=2500)
    first = first_splats(replace(sequence, body=body), settings, np.random.default_rng(0))
    parameters = first.parameters.copy()
    parameters[:, OPACITY] = 4.0
    bands = (np.floor(parameters[:, 1] * 4.0) % 2).astype(int)
    albedo = np.array([[0.5, 0.3, 0.2], [0.2, 0.3, 0.6]])[bands]
    parameters[:, COLOUR : COLOUR + 3] = to_srgb(albedo)
    model = SplatModel(
        parameters,
        first.joints.astype(np.uint8),
        first.weights,
        np.ones(2500, bool),
        body.skeleton,
        motion,
        "of a test",
    )
    frames = LitFrames(model, albedo, FILMED_IN)
    return model, albedo, replace(sequence, body=body, train=frames, motion=motion)


@cache
def trained_pillar() -> SplatModel:
    """What training makes of those frames, its light looked for."""
    sequence = filmed_pillar()[2]
    model = train(sequence, preset=PRESET, iterations=400, find_light=True, clock=ticking())
    assert isinstance(model, SplatModel)
    return model
