"""The live solver against the clip-wide fit, and both against the studio's truth.

Landmarks are MediaPipe's on raw footage: of a studio performer (a room, noise, a lens), or of a
clip of one's own, for which no truth is known.
"""

from __future__ import annotations

import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.live_expressions import ExpressionSolver, FaceAndHands, page_times
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import milliseconds
from capture.body.model import load_body_model
from capture.detection.landmarks import Landmarks, MediaPipeEstimator
from capture.detection.lifter import lift
from capture.detection.network_files import landmark_network_file
from capture.detection.tracking import track_person
from capture.errors import NoPersonFound
from capture.fitting.fit import fit_clip
from capture.fitting.world import place_in_world
from capture.live.solver import LiveSolver
from capture.segmentation.masks import refine_mask
from capture.sources.video import Clip, read_video
from capture.storage import open_sequence
from capture.studio import Footage, make_sequence
from scene.arrays import Array, Float
from scene.body import Body
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import JOINT_NAMES
from services.live.keypoints_packet import (
    EXPRESSION_KEYPOINTS_BYTES,
    KEYPOINTS_BYTES,
    KeypointsPacket,
    decode_keypoints,
    encode_keypoints,
)
from services.live.motion.live_motion import LiveMotion
from services.live.motion.receivers import KeypointReceiver
from services.settings import load_settings

FRAMES, RATE, SIZE, TURN_DEG = 90, 30.0, 512, 120.0
LATENCY_S = 0.06
"""What a frame is late by: camera, estimator, network."""
_ENDS = [i for i, name in enumerate(JOINT_NAMES) if name.endswith(("_hand", "_foot"))]
_SETTLED = 5
"""First frames that compile and settle; they are not judged."""


@dataclass(frozen=True, eq=False)
class _Known:
    """A body, a camera and a motion: the fit's or the truth."""

    body: Body
    camera: Camera
    motion: Motion

    def joints(self, pose: Pose) -> Float[Array, "J 3"]:
        """Joints in the camera's axes, m, without hands and toes, which nothing shows."""
        placed = self.body.skeleton.joint_transforms(pose.joint_angles, pose.root_translation)
        return np.delete(placed[:, :3, 3], _ENDS, axis=0) @ self.camera.rotation.T


def run(writer: FigureWriter, clip: Path | None) -> None:
    """Measure and report."""
    with tempfile.TemporaryDirectory(prefix="metanerf-bench-") as folder:
        truth = None
        if clip is None:
            truth, clip = _render_clip(Path(folder))
        figures = _measure(read_video(clip, max_frames=FRAMES), truth)
    source = "studio" if truth is not None else clip.name
    writer.write({"source": source, **figures})


def _render_clip(folder: Path) -> tuple[_Known, Path]:
    raw = folder / "raw.mp4"
    make_sequence(
        folder / "truth",
        look="lit",
        frames=FRAMES,
        size=SIZE,
        test_cameras=1,
        seed=1,
        turn_deg=TURN_DEG,
        frames_per_second=RATE,
        footage=Footage(raw, background="textured", noise=3.0, blur_px=0.6),
    )
    sequence = open_sequence(folder / "truth")
    return _Known(sequence.body, sequence.train.camera(0), sequence.motion), raw


def _measure(clip: Clip, truth: _Known | None) -> dict[str, Any]:
    with MediaPipeEstimator(
        landmark_network_file(load_settings().pose_model_source())
    ) as estimator:
        track = track_person(clip.images, estimator)
    found = [(i, person) for i, person in enumerate(track.people) if person is not None]
    if len(found) <= _SETTLED:
        raise NoPersonFound(f"the person must be seen in over {_SETTLED} frames; got {len(found)}")
    fitted = _fitted(clip, track.people, track.takes)
    times = clip.times_s
    solver = LiveSolver(fitted.body, fitted.camera, lifter=lift)
    poses, seconds, busy = _followed(solver, found, times)
    ours = {"live": poses, "clip_fit": [fitted.motion.pose(i) for i, _ in found]}
    raw, *_ = _followed(
        LiveSolver(fitted.body, fitted.camera, lifter=lift, smoothing=None), found, times
    )
    figures: dict[str, Any] = {
        "frames": len(found),
        "step": milliseconds(seconds[_SETTLED:]),
        "step_of_processor": milliseconds(busy[_SETTLED:]),
        "with_face_and_hands": _with_face_and_hands(fitted, found, times),
        "live_to_clip_fit": _apart(fitted, poses, fitted, ours["clip_fit"]),
        "live_unsmoothed_to_clip_fit": _apart(fitted, raw, fitted, ours["clip_fit"]),
        "in_a_meeting": _in_a_meeting(fitted, found, times),
        "packed_to_whole_numbers": _packed(fitted, found, times, poses),
    }
    if truth is None:
        return figures
    true = [truth.motion.pose_at(float(times[i])) for i, _ in found]
    figures |= {
        f"{name}_to_truth": _apart(fitted, some, truth, true) for name, some in ours.items()
    }
    own, *_ = _followed(LiveSolver(truth.body, truth.camera, lifter=lift), found, times)
    figures["live_with_true_body_and_camera_to_truth"] = _apart(truth, own, truth, true)
    # a pose that comes late is shown as it is, or moved on
    later = [truth.motion.pose_at(float(times[i]) + LATENCY_S) for i, _ in found]
    ahead, *_ = _followed(
        LiveSolver(truth.body, truth.camera, lifter=lift, latency_s=LATENCY_S), found, times
    )
    figures[f"late_by_{LATENCY_S * 1e3:.0f}_ms"] = {
        "as_it_is": _apart(truth, own, truth, later),
        "predicted": _apart(truth, ahead, truth, later),
    }
    return figures


def _with_face_and_hands(
    known: _Known, found: list[tuple[int, Landmarks]], times_s: Array
) -> dict[str, Any]:
    """A step in which a face and two hands are solved too; and those alone, on a page."""
    solver, expressions = LiveSolver(known.body, known.camera, lifter=lift), ExpressionSolver()
    seen = FaceAndHands.of_a_person()
    seconds, busy = [], []
    for index, person in found:
        started, worked = time.perf_counter(), time.thread_time()
        solver.step(person, float(times_s[index]))
        expressions.step(seen, float(times_s[index]))
        seconds.append(time.perf_counter() - started)
        busy.append(time.thread_time() - worked)
    return {
        "must_ms": 1.0,
        "aim_ms": 0.5,
        "step": milliseconds(seconds[_SETTLED:]),
        "step_of_processor": milliseconds(busy[_SETTLED:]),
        "face_and_hands_on_a_page": page_times(),
    }


def _in_a_meeting(
    known: _Known, found: list[tuple[int, Landmarks]], times_s: Array
) -> dict[str, Any]:
    """What keypoints cost on their way: bytes, and time from a packet's coming to its pose."""
    motion, seconds, busy, reading = LiveMotion(known.body.skeleton), [], [], []
    with ThreadPoolExecutor(1) as executor:
        receiver = KeypointReceiver(motion, executor, time.perf_counter)
        for number, (index, seen) in enumerate(found):
            data = encode_keypoints(_packet(number, seen, known.camera, float(times_s[index])))
            worked = executor.submit(time.thread_time).result()
            started = time.perf_counter()
            receiver.receive(data)
            busy.append(executor.submit(time.thread_time).result() - worked)
            seconds.append(time.perf_counter() - started)
            started = time.perf_counter()
            motion.pose_at(started)
            reading.append(time.perf_counter() - started)
    sizes = {"body": KEYPOINTS_BYTES, "with_face_and_hands": EXPRESSION_KEYPOINTS_BYTES}
    return {
        "packet_bytes": sizes,
        "kbit_s": {name: round(8e-3 * size * RATE, 1) for name, size in sizes.items()},
        "packet_to_pose": milliseconds(seconds[_SETTLED:]),
        "packet_to_pose_of_processor": milliseconds(busy[_SETTLED:]),
        "reading_a_pose": milliseconds(reading[_SETTLED:]),
    }


def _packet(number: int, seen: Landmarks, camera: Camera, time_s: float) -> KeypointsPacket:
    width, height = camera.width, camera.height
    xy = seen.pixels / [width, height]
    return KeypointsPacket(number, 1e3 * time_s, width, height, xy, seen.world, seen.visibility)


def _packed(
    known: _Known, found: list[tuple[int, Landmarks]], times_s: Array, whole: list[Pose]
) -> dict[str, float]:
    """What is lost by few bits: poses from landmarks that were packed, against `whole`."""
    read = []
    for index, seen in found:
        packet = decode_keypoints(encode_keypoints(_packet(0, seen, known.camera, 0.0)))
        pixels = packet.xy * [packet.width, packet.height]
        read.append(
            (index, replace(seen, pixels=pixels, world=packet.world, visibility=packet.visibility))
        )
    poses, *_ = _followed(LiveSolver(known.body, known.camera, lifter=lift), read, times_s)
    ours, theirs = (
        axis_angle_to_matrix(np.stack([pose.joint_angles for pose in some]))[_SETTLED:]
        for some in (poses, whole)
    )
    turned = np.linalg.norm(matrix_to_axis_angle(np.swapaxes(ours, -1, -2) @ theirs), axis=-1)
    shown = np.degrees(np.delete(turned, _ENDS, axis=1))
    return {
        **_apart(known, poses, known, whole),
        "mean_deg": round(float(shown.mean()), 2),
        "p95_deg": round(float(np.percentile(shown, 95)), 2),
    }


def _fitted(clip: Clip, people: tuple[Landmarks | None, ...], takes: tuple[int, ...]) -> _Known:
    masks = [
        None if person is None else refine_mask(image, person)
        for image, person in zip(clip.images, people, strict=True)
    ]
    model = load_body_model()
    fit = fit_clip(people, masks, clip.times_s, takes, model, lifter=lift, images=clip.images)
    placed = place_in_world(fit, clip.times_s)
    height, width = clip.images[0].shape[:2]
    k = np.array([[fit.focal_px, 0.0, width / 2], [0.0, fit.focal_px, height / 2], [0.0, 0.0, 1.0]])
    return _Known(placed.body, Camera(k, placed.world_to_camera, width, height), placed.motion)


def _followed(
    solver: LiveSolver, found: list[tuple[int, Landmarks]], times_s: Array
) -> tuple[list[Pose], list[float], list[float]]:
    """Poses, s that each took by the clock, and s of the processor: others may use it too."""
    poses, seconds, busy = [], [], []
    for index, person in found:
        started, worked = time.perf_counter(), time.thread_time()
        poses.append(solver.step(person, float(times_s[index])))
        seconds.append(time.perf_counter() - started)
        busy.append(time.thread_time() - worked)
    return poses, seconds, busy


def _apart(one: _Known, ours: list[Pose], other: _Known, theirs: list[Pose]) -> dict[str, float]:
    """Distances of joints as seen from the pelvis, mm; jitter: of their second differences."""
    a = np.stack([one.joints(pose) for pose in ours])[_SETTLED:]
    b = np.stack([other.joints(pose) for pose in theirs])[_SETTLED:]
    gaps = np.linalg.norm((a - a[:, :1]) - (b - b[:, :1]), axis=2)
    shake = np.linalg.norm(np.diff(a, 2, axis=0) - np.diff(b, 2, axis=0), axis=2)
    return {
        "mean_mm": round(1e3 * float(gaps.mean()), 1),
        "p95_mm": round(1e3 * float(np.percentile(gaps, 95)), 1),
        "jitter_mm": round(1e3 * float(shake.mean()), 2),
    }
