"""Axes of a live meeting: what viewers see where keypoints come late, seldom, or not at all.

A performer's true motion becomes landmarks, packets, and poses again, by the product's own live
motion. Pictures of the model in these poses are judged by pictures of the same model in the true
ones. One shift of the root and one delay for the whole run are taken out: people are shown at their
place, and nobody sees that everything is a tenth of a second late.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from benchmarks.stability.axis import Axis
from benchmarks.stability.channel import LATENCY_S, MISSING, Channel
from benchmarks.stability.judge import (
    NoPicture,
    distance,
    guarded,
    mean,
    shown,
)
from capture.body.landmark_names import LANDMARK_NAMES
from capture.body.landmarks import landmarks_on
from capture.studio.motions import gesture_motion
from renderer.evaluation.lpips import Lpips
from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float
from scene.body import Body
from scene.camera import Camera, orbit_camera
from scene.errors import InvalidInput
from scene.motion import Motion, Pose
from scene.sequence import Frame
from scene.skeleton import Skeleton
from services.live.keypoints_packet import KeypointsPacket, decode_keypoints, encode_keypoints
from services.live.motion.live_motion import LiveMotion
from services.live.packets import is_newer

MEETING = "live meeting"
_SECONDS, _SETTLED_S = 7.0, 1.0
_SHOWN_HZ = 15.0
_DELAYS_S = np.arange(0.0, 0.31, 0.02)
_JUDGED_EVERY = 6
"""LPIPS and PSNR are of every sixth picture, flicker of all."""
_WEBCAM_PX, _WEBCAM_FOV_RAD = 512, 2.0 * float(np.arctan(0.5 / 0.87))
_HIPS = [LANDMARK_NAMES.index("left_hip"), LANDMARK_NAMES.index("right_hip")]


@dataclass(frozen=True)
class LiveAxis(Axis):
    """Disturbs the channel."""

    channel: Callable[[float], Channel] = field(kw_only=True)
    has_floor: ClassVar[bool] = False
    """What is judged is motion: the model is its own truth."""


LIVE_AXES = (
    LiveAxis("packet_loss", "packets lost", MEETING, (0.0, 0.05, 0.1, 0.2, 0.3), " of all",
             channel=lambda share: Channel(loss=share)),
    LiveAxis("bursts", "nothing comes, every two seconds, for", MEETING,
             (0.0, 0.1, 0.2, 0.4, 0.8), " s", channel=lambda s: Channel(outage_s=s)),
    LiveAxis("jitter", "packets late by up to", MEETING, (0.0, 25.0, 50.0, 100.0, 200.0), " ms",
             channel=lambda ms: Channel(jitter_s=1e-3 * ms)),
    LiveAxis("packet_rate", "packets a second", MEETING, (30.0, 15.0, 10.0, 5.0),
             channel=lambda hz: Channel(rate_hz=hz)),
    LiveAxis("packet_rate_high", "packets a second, more", MEETING, (30.0, 45.0, 60.0),
             channel=lambda hz: Channel(rate_hz=hz)),
    LiveAxis("clock_skew", "camera's clock is fast by", MEETING, (0.0, 0.01, 0.1, 1.0, 5.0), " %",
             channel=lambda percent: Channel(skew=0.01 * percent)),
    LiveAxis("missing_part", "not seen", MEETING, (0.0, 1.0, 2.0, 3.0), labels=MISSING,
             channel=lambda step: Channel(missing=MISSING[int(step)])),
    LiveAxis("live_dropped", "landmarks dropped, live", MEETING,
             (0.0, 0.1, 0.3, 0.5, 0.7), " of them",
             channel=lambda share: Channel(dropped=share)),
    LiveAxis("live_exchanged", "left and right exchanged, live", MEETING,
             (0.0, 0.02, 0.05, 0.1, 0.2), " of frames",
             channel=lambda share: Channel(exchanged=share)),
    LiveAxis("silence", "nothing comes, once, for", MEETING, (0.0, 0.25, 0.5, 1.0, 2.0), " s",
             channel=lambda s: Channel(silence_s=s)),
)  # fmt: skip


def measure(
    axis: LiveAxis, step: float, model: PerformerModel, body: Body, size_px: int, lpips: Lpips
) -> dict[str, Any]:
    """The outcome and figures of one channel."""
    channel, rng = axis.channel(step), axis.rng()
    return guarded(lambda: _figures(channel, rng, model, body, size_px, lpips))


def drive(
    channel: Channel, motion: Motion, body: Body, rng: np.random.Generator
) -> tuple[list[tuple[float, Pose]], dict[str, int]]:
    """What is shown of `motion`, with the moment it should show, and what became of packets."""
    live, told = LiveMotion(body.skeleton), {"solved": 0, "refused": 0, "late": 0}
    waiting = channel.deliveries(_SECONDS, rng)
    newest, poses = -1, []
    for now_s in np.arange(0.0, _SECONDS, 1.0 / _SHOWN_HZ).tolist():
        while waiting and waiting[0][1] <= now_s:
            sent_s, arrived_s = waiting.pop(0)
            sequence = round(sent_s * channel.rate_hz)
            if newest >= 0 and not is_newer(sequence, newest):
                told["late"] += 1
                continue
            newest = sequence
            packet = _packet(channel, sequence, sent_s, motion, body, rng)
            try:
                live.update(packet, arrived_s)
                told["solved"] += 1
            except InvalidInput:
                told["refused"] += 1
        pose = live.pose_at(now_s)
        if pose is not None and now_s >= _SETTLED_S:
            poses.append((now_s - LATENCY_S, pose))
    return poses, told


def _figures(
    channel: Channel,
    rng: np.random.Generator,
    model: PerformerModel,
    body: Body,
    size_px: int,
    lpips: Lpips,
) -> dict[str, Any]:
    motion = gestures()
    poses, told = drive(channel, motion, body, rng)
    if not poses:
        raise NoPicture("somebody who is driven live must be shown; got no pose in the whole run")
    skeleton = body.skeleton
    runs = [_beside(motion, poses, delay_s) for delay_s in _DELAYS_S]
    errors = [_joint_mm(skeleton, truth, ours) for truth, ours in runs]
    best = int(np.argmin(errors))
    truth, ours = runs[best]
    camera = orbit_camera((0.0, 0.9, 0.0), 3.6, 0.3, 0.1, size_px, size_px)
    frames = [_frame(model, camera, pose) for pose in truth]
    seen = [
        shown(model, frame, pose)
        for frame, pose in list(zip(frames, ours, strict=True))[::_JUDGED_EVERY]
    ]
    return {
        "psnr": _rounded(mean(one.decibels for one in seen)),
        "lpips": _rounded(mean(distance(lpips, one) for one in seen)),
        "psnr_worst_view": _rounded(min(one.decibels for one in seen)),
        "flicker": _rounded(_flicker(model, frames, ours)),
        "joint_mm": _rounded(errors[best]),
        "delay_ms": round(1e3 * float(_DELAYS_S[best])),
        **told,
    }


def _beside(
    motion: Motion, poses: list[tuple[float, Pose]], delay_s: float
) -> tuple[list[Pose], list[Pose]]:
    """The true poses of `delay_s` before, and ours shifted to their mean place."""
    truth = [motion.pose_at(time_s - delay_s) for time_s, _ in poses]
    pairs = zip(truth, poses, strict=True)
    shift = np.mean([t.root_translation - p.root_translation for t, (_, p) in pairs], axis=0)
    return truth, [replace(p, root_translation=p.root_translation + shift) for _, p in poses]


def _flicker(model: PerformerModel, frames: list[Frame], poses: list[Pose]) -> float:
    """Of what is shown, by the model in the true poses."""
    pictures = [
        model.render(frame.camera, pose)[..., :3].copy()
        for frame, pose in zip(frames, poses, strict=True)
    ]
    ours = true = 0.0
    for place in range(1, len(frames)):
        early, late = frames[place - 1], frames[place]
        person = (early.mask > 0.5) | (late.mask > 0.5)
        ours += float(np.abs(pictures[place] - pictures[place - 1])[person].mean())
        true += float(np.abs(late.image - early.image)[person].mean())
    return ours / max(true, 1e-6)


def _frame(model: PerformerModel, camera: Camera, pose: Pose) -> Frame:
    drawn = model.render(camera, pose).copy()
    return Frame(np.clip(drawn[..., :3], 0.0, 1.0), drawn[..., 3], camera, pose)


def gestures() -> Motion:
    """Gestures, a lifted knee and a bend, facing the camera."""
    motion = gesture_motion(round(30.0 * (_SECONDS + 1.0)), 30.0)
    angles = motion.joint_angles.copy()
    angles[:, 0] = 0.0
    return replace(motion, joint_angles=angles)


def _packet(
    channel: Channel,
    sequence: int,
    sent_s: float,
    motion: Motion,
    body: Body,
    rng: np.random.Generator,
) -> KeypointsPacket:
    pixels, world = landmarks_of(body, motion.pose_at(sent_s))
    pixels, world, visibility = channel.seen(pixels, world, rng)
    packet = KeypointsPacket(
        sequence,
        1e3 * channel.camera_time_s(sent_s),
        _WEBCAM_PX,
        _WEBCAM_PX,
        pixels / _WEBCAM_PX,
        world,
        visibility,
    )
    return decode_keypoints(encode_keypoints(packet))


def landmarks_of(body: Body, pose: Pose) -> tuple[Float[Array, "33 2"], Float[Array, "33 3"]]:
    """What a perfect estimator says of `pose` at a webcam: px, and m about the hips."""
    camera = orbit_camera((0.0, 0.9, 0.0), 2.4, 0.0, 0.0, _WEBCAM_PX, _WEBCAM_PX, _WEBCAM_FOV_RAD)
    rest, joints = landmarks_on(body)
    moved = body.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)[joints]
    points = np.einsum("nij,nj->ni", moved[:, :3, :3], rest) + moved[:, :3, 3]
    pixels, _ = camera.project(points)
    return pixels, (points - points[_HIPS].mean(axis=0)) @ camera.rotation.T


def _joint_mm(skeleton: Skeleton, truth: list[Pose], poses: list[Pose]) -> float:
    places = [
        skeleton.joint_transforms(
            np.stack([pose.joint_angles for pose in some]),
            np.stack([pose.root_translation for pose in some]),
        )[..., :3, 3]
        for some in (truth, poses)
    ]
    return 1e3 * float(np.linalg.norm(places[0] - places[1], axis=-1).mean())


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
