"""Whether splats are better learnt from a trained field's pictures than from the clip's own.

A field can be drawn from where no camera stood, in poses that nobody struck. Splats are trained on
such pictures alone (*distilled*), on them and the clip's frames (*both*), and on the frames alone
(*direct*), as long each; the first performer of the studio, exact poses.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import clock_named
from capture.storage import open_sequence
from capture.studio import make_sequence
from renderer.evaluation.evaluate import evaluate
from renderer.performer_model import PerformerModel
from renderer.training import train
from scene.arrays import Array, Float
from scene.camera import Camera, look_at
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE, FrameSource, Sequence

FRAMES, SIZE = 60, 256
FIELD_S, SPLATS_S = 90.0, 20.0
VIEWS = 120
_GESTURE_RAD = 0.15
"""How far each joint of a drawn pose is turned away from the clip's."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """Pictures of a model, as a `FrameSource`."""

    pictures: list[Float[Array, "H W 4"]]
    cameras: list[Camera]
    poses: list[Pose]

    def __len__(self) -> int:
        return len(self.pictures)

    def camera(self, index: int) -> Camera:
        return self.cameras[index]

    def pose(self, index: int) -> Pose:
        return self.poses[index]

    def image(self, index: int) -> Float[Array, "H W 3"]:
        return np.clip(self.pictures[index][..., :3], 0.0, 1.0)

    def mask(self, index: int) -> Float[Array, "H W"]:
        return np.clip(self.pictures[index][..., 3], 0.0, 1.0)


def run(writer: FigureWriter, clock_name: str) -> None:
    """Train the field, draw it, train splats in three ways, judge all four."""
    clock = clock_named(clock_name)
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "sequence"
        make_sequence(path, frames=FRAMES, size=SIZE)
        clip = open_sequence(path)
        field = train(clip, preset="fast", budget_s=FIELD_S, clock=clock.now)
        drawn = draw_round(field, clip, np.random.default_rng(0))
        figures = {f"fast, {FIELD_S:g} s": _judged(field, clip)}
        ways = {"direct": clip, "distilled": of(drawn, clip), "both": of(joined(clip, drawn), clip)}
        for way, frames in ways.items():
            model = train(frames, preset="splats", budget_s=SPLATS_S, clock=clock.now)
            figures[f"splats, {way}, {SPLATS_S:g} s"] = _judged(model, clip)
    about = {
        "frames": FRAMES,
        "size": SIZE,
        "poses": "exact",
        "region": "body crop",
        "drawn_views": VIEWS,
        **clock.about(),
    }
    writer.write({**about, "psnr": figures})


def draw_round(
    model: PerformerModel, clip: Sequence, rng: np.random.Generator, views: int = VIEWS
) -> Drawn:
    """`model` from all round, in the clip's poses, each a little changed."""
    drawn = Drawn([], [], [])
    for view in range(views):
        frame = view % len(clip.train)
        given, camera = clip.train.pose(frame), clip.train.camera(frame)
        turns = rng.normal(0.0, _GESTURE_RAD, given.joint_angles.shape)
        turns[0] = 0.0
        pose = Pose(given.joint_angles + turns, given.root_translation, view / 15.0)
        camera = _carried_round(camera, clip, float(rng.uniform(-np.pi, np.pi)))
        drawn.pictures.append(model.render(camera, pose))
        drawn.cameras.append(camera)
        drawn.poses.append(pose)
    return drawn


def of(source: FrameSource, clip: Sequence) -> Sequence:
    """`clip` with the frames of `source` to learn from."""
    poses = [replace(source.pose(i), time_s=i / 15.0) for i in range(len(source))]
    return replace(clip, train=source, motion=Motion.from_poses(poses))


def joined(clip: Sequence, drawn: Drawn) -> Drawn:
    """The clip's own frames, then the drawn ones."""
    frames = range(len(clip.train))
    own = [
        np.concatenate([clip.train.image(i), clip.train.mask(i)[..., None]], axis=2) for i in frames
    ]
    return Drawn(
        own + drawn.pictures,
        [clip.train.camera(i) for i in frames] + drawn.cameras,
        [clip.train.pose(i) for i in frames] + drawn.poses,
    )


def _carried_round(camera: Camera, clip: Sequence, azimuth_rad: float) -> Camera:
    """`camera` carried round the upright axis through the person, looking at the same height."""
    middle = clip.motion.root_translation.mean(axis=0) + clip.body.skeleton.rest_joints[0]
    turn = axis_angle_to_matrix(np.array([0.0, azimuth_rad, 0.0]))
    eye = middle + turn @ (camera.position - middle)
    return replace(camera, world_to_camera=look_at(eye, middle))


def _judged(model: PerformerModel, clip: Sequence) -> dict[str, Any]:
    figures = evaluate(model, clip)["psnr"]
    return {split: round(figures[split]["body_crop"], 2) for split in (NOVEL_VIEW, UNSEEN_POSE)}
