"""Renders a studio performer into a sequence folder with exact ground truth for every view."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from capture.errors import CaptureError
from capture.sources.bvh import read_bvh
from capture.storage import write_sequence
from capture.studio.expressions import with_random_expressions
from capture.studio.footage import Footage, FootageWriter
from capture.studio.garments import Drape, drape
from capture.studio.lifelike.performer import make_lifelike_performer
from capture.studio.light import EnvironmentLight
from capture.studio.motions import gesture_motion, turntable_motion, with_turn
from capture.studio.named_performers import (
    LIFELIKE_PERFORMERS,
    motion_file_of,
    seed_of_performer,
)
from capture.studio.performer import FilmedPerformer, make_performer
from scene.arrays import Array, Float
from scene.camera import Camera, orbit_camera
from scene.environment import Environment
from scene.motion import Motion, Pose
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE, Frame, PoseTrust
from scene.skeleton import JOINT_NAMES, Skeleton

LOOKS = ("plain", "lit", "loose")
"""Flat light; the light of a room; flat light, in clothes that swing."""
FRAMINGS = ("body", "head")
"""The whole motion, or head and shoulders."""
FRAMES_PER_SECOND = 10.0
"""A full turn of 60 frames takes six seconds."""
_SHUTTER_SAMPLES = 7
"""Renders averaged into a frame while the shutter is open."""
_NOVEL_VIEW_FRAMES, _UNSEEN_POSE_FRAMES = 16, 8
_FIELD_OF_VIEW_RAD = 0.6
_FILL_SHARE = 0.9
"""Share of the picture's height that the whole motion may fill."""
_HEAD_REACH_M = 0.25
"""Half the height of a picture of head and shoulders."""
_HEAD_CENTRE_M = 0.03
"""How far above the head's joint its middle lies."""


@dataclass(frozen=True, eq=False)
class _AnimatedPerformer:
    """A performer with a motion, in a look."""

    performer: FilmedPerformer
    motion: Motion
    look: str
    cloth: Drape | None
    light: EnvironmentLight | None

    @classmethod
    def of(
        cls,
        performer: FilmedPerformer,
        motion: Motion,
        look: str,
        light: EnvironmentLight | None = None,
    ) -> _AnimatedPerformer:
        loose = look == "loose"
        cloth = drape(performer.garments, performer.body, motion) if loose else None
        return cls(performer, motion, look, cloth, light)

    def render(
        self, pose: Pose, camera: Camera
    ) -> tuple[Float[Array, "H W 3"], Float[Array, "H W"]]:
        """The performer in `pose` from `camera`: sRGB premultiplied by alpha, and alpha."""
        cloth = None if self.cloth is None else self.cloth.at(pose.time_s)
        return self.performer.render(pose, camera, self.look, cloth, self.light)

    def render_motion_blurred(
        self, time_s: float, camera: Camera, open_s: float
    ) -> tuple[Float[Array, "H W 3"], Float[Array, "H W"]]:
        """The same with motion blur: the mean over a shutter open for `open_s` about `time_s`."""
        times = time_s + open_s * np.linspace(-0.5, 0.5, _SHUTTER_SAMPLES)
        renders = [self.render(self.motion.pose_at(float(time)), camera) for time in times]
        return (
            np.mean([image for image, _ in renders], axis=0),
            np.mean([alpha for _, alpha in renders], axis=0),
        )


def make_sequence(
    out: Path,
    *,
    performer: str | None = None,
    assets: Path | None = None,
    motion: Path | None = None,
    look: str = "plain",
    frames: int = 60,
    size: int = 256,
    test_cameras: int = 8,
    seed: int = 0,
    turn_deg: float = 360.0,
    frames_per_second: float = FRAMES_PER_SECOND,
    footage: Footage | None = None,
    environment: Environment | None = None,
    expressions: bool = False,
    framing: str = "body",
    uniform: bool = False,
    on_progress: Callable[[float, str], None] | None = None,
) -> None:
    """Write a sequence of the performer `seed`, or of the named `performer`, to `out`.

    Training frames come from one camera; test frames from a ring of `test_cameras` others, at
    moments of the training motion (novel_view) and of another motion (unseen_pose). With `motion`
    (.bvh, or a folder that holds the performer's clip) the first three quarters train and the rest,
    turned alike, is the unseen motion.

    The lifelike performers are made of the files in `assets`, MakeHuman's.

    With `footage`, the raw training frames are written too, as the camera records them (room,
    noise, blur), as input of a capture; the sequence itself stays clean:

        make_sequence(
            Path("truth.seq"), size=512, frames_per_second=30.0,
            footage=Footage(Path("raw.mp4"), background="textured", noise=2.0, blur_px=0.6),
        )

    With `expressions` they talk, blink, smile and close their hands, as the sequence's motion
    records; `framing` is of the whole `body`, or of head and shoulders (`head`). `uniform` clothes
    have one colour each; the lifelike performers have their own.

    In the look `lit`, an `environment` with a panorama lights the performer; none: the studio's own
    light, sRGB values dimmed by a key light and a sky.

    Raises CaptureError for numbers out of range or an unknown look, BrokenMotionCapture for an
    unreadable file.
    """
    _check(look, framing, frames, size, test_cameras, turn_deg, frames_per_second)
    light = _environment_light(look, environment)
    seed = seed if performer is None else seed_of_performer(performer)
    motion = None if motion is None else motion_file_of(motion, performer)
    subject = _subject(performer, assets, seed, look, expressions, uniform)
    skeleton = subject.body.skeleton
    train_motion, unseen_motion = _motions(motion, skeleton, frames, turn_deg, frames_per_second)
    if expressions:
        train_motion, unseen_motion = (
            with_random_expressions(train_motion, 2 * seed),
            with_random_expressions(unseen_motion, 2 * seed + 1),
        )
    frame_camera = frame_head if framing == "head" else _frame_body
    centre, distance = frame_camera(skeleton, train_motion)
    camera = orbit_camera(centre, distance, 0.0, 0.05, size, size, _FIELD_OF_VIEW_RAD)
    centre, distance = frame_camera(skeleton, train_motion, unseen_motion)
    ring = [
        orbit_camera(centre, distance, azimuth, elevation, size, size, _FIELD_OF_VIEW_RAD)
        for azimuth, elevation in zip(
            2.0 * np.pi * (np.arange(test_cameras) + 0.5) / test_cameras,
            0.05 + 0.2 * (np.arange(test_cameras) % 2),
            strict=True,
        )
    ]
    novel_indices, unseen_indices = (
        _evenly_spaced(len(train_motion), _NOVEL_VIEW_FRAMES),
        _evenly_spaced(len(unseen_motion), _UNSEEN_POSE_FRAMES),
    )
    total = frames + len(novel_indices) + len(unseen_indices)
    done = 0

    def rendered_frames(
        animated: _AnimatedPerformer, indices: Array, cameras: list[Camera]
    ) -> Iterator[Frame]:
        nonlocal done
        for number, index in enumerate(indices):
            view_camera, pose = cameras[number % len(cameras)], animated.motion.pose(int(index))
            image, mask = animated.render(pose, view_camera)
            done += 1
            if on_progress is not None:
                on_progress(done / total, f"frame {done} of {total}")
            yield Frame(image, mask, view_camera, pose)

    train_performer, unseen_performer = (
        _AnimatedPerformer.of(subject, one_motion, look, light)
        for one_motion in (train_motion, unseen_motion)
    )

    def training_frames(writer: FootageWriter | None) -> Iterator[Frame]:
        for frame in rendered_frames(train_performer, np.arange(frames), [camera]):
            if writer is not None and footage is not None:
                open_s = footage.shutter / frames_per_second
                recorded = (frame.image, frame.mask)
                if open_s > 0.0:
                    recorded = train_performer.render_motion_blurred(
                        frame.pose.time_s, camera, open_s
                    )
                writer.add(*recorded)
            yield frame

    recording = (
        nullcontext()
        if footage is None
        else FootageWriter(footage, camera, frames_per_second, seed)
    )
    with recording as writer:
        write_sequence(
            out,
            person=f"studio performer {seed}" if performer is None else performer,
            frames_per_second=frames_per_second,
            body=subject.known_body,
            train=training_frames(writer),
            test={
                NOVEL_VIEW: rendered_frames(train_performer, novel_indices, ring),
                UNSEEN_POSE: rendered_frames(unseen_performer, unseen_indices, ring),
            },
            source=f"studio look={look} seed={seed} turn={turn_deg:g}"
            + (f" environment={environment.name}" if environment else "")
            + (" expressions" if expressions else "")
            + (f" framing={framing}" if framing != "body" else "")
            + (" uniform" if uniform else ""),
            pose_trust=PoseTrust.EXACT,
        )


def _check(
    look: str, framing: str, frames: int, size: int, test_cameras: int, turn_deg: float, rate: float
) -> None:
    for kind, value, known in (("look", look, LOOKS), ("framing", framing, FRAMINGS)):
        if value not in known:
            raise CaptureError(f"{kind} must be one of {', '.join(known)}; got {value!r}")
    for name, value, least in (
        ("frames", frames, 1),
        ("size", size, 16),
        ("test_cameras", test_cameras, 1),
    ):
        if value < least:
            raise CaptureError(f"{name} must be at least {least}; got {value}")
    if not np.isfinite(turn_deg):
        raise CaptureError(f"turn_deg must be finite; got {turn_deg}")
    if not 0.0 < rate <= 240.0:
        raise CaptureError(f"frames_per_second must be above 0 and at most 240; got {rate}")


def _subject(
    performer: str | None,
    assets: Path | None,
    seed: int,
    look: str,
    expressive: bool,
    uniform: bool,
) -> FilmedPerformer:
    row = None if performer is None else LIFELIKE_PERFORMERS.get(performer)
    if row is None:
        if assets is not None:
            raise CaptureError(
                "assets must go with a lifelike performer of "
                f"{', '.join(LIFELIKE_PERFORMERS)}; got performer {performer!r}"
            )
        return make_performer(seed, expressive=expressive, uniform=uniform)
    if look == "loose":
        raise CaptureError(
            f"look must be plain or lit for the lifelike {performer}; got 'loose', which the "
            "painted performers have"
        )
    if assets is None:
        raise CaptureError(
            f"assets must be the folder with MakeHuman's assets for the lifelike {performer}; got "
            "none; docs/data.md says where to fetch them"
        )
    return make_lifelike_performer(row, assets, expressive=expressive)


def _environment_light(look: str, environment: Environment | None) -> EnvironmentLight | None:
    if environment is None:
        return None
    if look != "lit" or environment.panorama is None:
        raise CaptureError(
            "environment must have a panorama and go with the look lit; got look "
            f"{look!r} and environment {environment.name!r}"
        )
    return EnvironmentLight(environment.panorama)


def _motions(
    path: Path | None, skeleton: Skeleton, frames: int, turn_deg: float, rate: float
) -> tuple[Motion, Motion]:
    if path is None:
        return turntable_motion(frames, rate, turn_deg), gesture_motion(32, rate)
    whole = read_bvh(path, skeleton)
    cut_s = 0.75 * whole.duration_s
    start_s, end_s = whole.times_s[0], whole.times_s[-1]
    return (
        with_turn(_motion_span(whole, start_s, start_s + cut_s, frames, rate), turn_deg),
        with_turn(_motion_span(whole, start_s + cut_s, end_s, 32, rate), turn_deg),
    )


def _motion_span(motion: Motion, start_s: float, end_s: float, frames: int, rate: float) -> Motion:
    """`frames` poses of [start_s, end_s) at `rate`; a span too short is played back and forth.

    On the spot, as on a treadmill: over a path of metres the person would be small in the picture.
    """
    times = np.arange(frames) / rate
    span = max(end_s - start_s, 1e-6)
    poses = [motion.pose_at(start_s + span - abs(span - time % (2.0 * span))) for time in times]
    root = np.stack([pose.root_translation for pose in poses]) * [0.0, 1.0, 0.0]
    angles = np.stack([pose.joint_angles for pose in poses])
    return Motion(times, angles, root, np.ones(angles.shape[:2]))


def _frame_body(skeleton: Skeleton, *motions: Motion) -> tuple[Float[Array, "3"], float]:
    """Target and distance of a camera whose picture every pose fits and fills."""
    joints = np.concatenate(
        [
            skeleton.joint_transforms(m.joint_angles, m.root_translation)[..., :3, 3].reshape(-1, 3)
            for m in motions
        ]
    )
    margin = 0.13  # the joints end in the head's centre, the knuckles and the toes
    hands = [name.endswith(("wrist", "hand")) for name in skeleton.names]
    below = np.tile(np.where(hands, margin, 0.05), len(joints) // len(hands))
    low, high = (joints[:, 1] - below).min(), joints[:, 1].max() + 2.0 * margin
    sideways = float(np.abs(joints[:, [0, 2]]).max()) + margin
    reach = max(sideways, 0.5 * (high - low))
    distance = reach / (_FILL_SHARE * np.tan(0.5 * _FIELD_OF_VIEW_RAD))
    # perspective enlarges what is nearer to the camera
    return np.array([0.0, 0.5 * (low + high), 0.0]), float(distance + 0.5 * sideways)


def frame_head(skeleton: Skeleton, *motions: Motion) -> tuple[Float[Array, "3"], float]:
    """Target and distance of a camera that shows head and shoulders throughout."""
    head = JOINT_NAMES.index("head")
    places = np.concatenate(
        [
            skeleton.joint_transforms(m.joint_angles, m.root_translation)[:, head, :3, 3]
            for m in motions
        ]
    )
    low, high = places.min(axis=0), places.max(axis=0)
    reach = _HEAD_REACH_M + 0.5 * float((high - low)[1])
    centre = 0.5 * (low + high) + [0.0, _HEAD_CENTRE_M, 0.0]
    return centre, float(reach / np.tan(0.5 * _FIELD_OF_VIEW_RAD))


def _evenly_spaced(length: int, count: int) -> Array:
    return np.unique(np.linspace(0, length - 1, min(count, length)).round().astype(int))
