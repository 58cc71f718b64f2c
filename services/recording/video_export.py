"""A recording as a video: drawn along a camera's path, everybody's voice in time with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.video.stream import VideoStream

from renderer.scene_renderer import SceneRenderer
from scene.arrays import Array, Float
from scene.camera import Camera, look_at, orbit_camera
from scene.errors import InvalidInput
from services.recording.replay import LoadedRecording
from services.recording.voices import mix
from services.synthetic import VIDEO_METADATA

FRAMES_PER_SECOND = 30
AUDIO_RATE = 48_000
_AAC_SAMPLES = 1024
_EYE_M = 0.95


@dataclass(frozen=True)
class CameraKeyframe:
    """Position and target of the camera at a moment."""

    at_s: float
    position: tuple[float, float, float]
    target: tuple[float, float, float]


@dataclass(frozen=True)
class CameraPath:
    """The camera of a video, its size in px; without keyframes, it orbits everybody once."""

    keyframes: Sequence[CameraKeyframe]
    width: int
    height: int
    fov_y_rad: float


def export_video(
    recorded: LoadedRecording, path: CameraPath, out: Path, on_progress: Callable[[float], None]
) -> None:
    """Write an MP4 (H.264, AAC), marked as synthetic, whole or not at all.

    `on_progress` may raise, to stop.
    Raises InvalidInput for a recording that has no moment to show, and as
    `services.recording.voices.mix`.
    """
    if recorded.duration_s <= 0.0:
        raise InvalidInput("a recording must hold something to be exported; got an empty one")
    part = out.with_name(f"{out.stem}.part.mp4")
    try:
        with av.open(str(part), "w") as container:
            container.metadata.update(VIDEO_METADATA)
            video = container.add_stream("libx264", rate=FRAMES_PER_SECOND)
            video.width, video.height, video.pix_fmt = path.width, path.height, "yuv420p"
            sound = container.add_stream("aac", rate=AUDIO_RATE, layout="mono")
            mixed = mix(recorded.voices, recorded.duration_s)
            _write_video(container, video, recorded, path, on_progress)
            _write_sound(container, sound, mixed)
        part.replace(out)
    finally:
        part.unlink(missing_ok=True)


def camera_at(recorded: LoadedRecording, path: CameraPath, at_s: float) -> Camera:
    """The camera at a moment: between its keyframes, or on its orbit round everybody."""
    if path.keyframes:
        keyframes = sorted(path.keyframes, key=lambda keyframe: keyframe.at_s)
        times = [keyframe.at_s for keyframe in keyframes]
        positions = np.array([[*keyframe.position, *keyframe.target] for keyframe in keyframes])
        now = [float(np.interp(at_s, times, column)) for column in positions.T]
        pose = look_at(tuple(now[:3]), tuple(now[3:]))
        return Camera.from_field_of_view(pose, path.width, path.height, path.fov_y_rad)
    scene = recorded.scene_at(at_s)
    found = [
        _pelvis(one.model.skeleton.rest_joints[0], one.pose.root_translation)
        for one in scene.performers
    ]
    positions = np.array(found or [(0.0, _EYE_M, 0.0)])
    middle = positions.mean(axis=0) * [1.0, 0.0, 1.0] + [0.0, _EYE_M, 0.0]
    spread = float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).max())
    azimuth = 2.0 * np.pi * at_s / recorded.duration_s
    return orbit_camera(
        middle, 3.4 + 2.0 * spread, azimuth, 0.08, path.width, path.height, path.fov_y_rad
    )


def _write_video(
    container: OutputContainer,
    stream: VideoStream,
    recorded: LoadedRecording,
    path: CameraPath,
    on_progress: Callable[[float], None],
) -> None:
    renderer = SceneRenderer()
    count = max(1, int(recorded.duration_s * FRAMES_PER_SECOND))
    for number in range(count):
        at_s = number / FRAMES_PER_SECOND
        camera = camera_at(recorded, path, at_s)
        picture = renderer.render(recorded.scene_at(at_s), camera)
        container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        on_progress((number + 1) / count)
    container.mux(stream.encode())


def _write_sound(
    container: OutputContainer, stream: AudioStream, samples: Float[Array, "S"]
) -> None:
    for start in range(0, len(samples), _AAC_SAMPLES):
        piece = np.ascontiguousarray(samples[None, start : start + _AAC_SAMPLES])
        frame = av.AudioFrame.from_ndarray(piece, format="fltp", layout="mono")
        frame.sample_rate, frame.pts = AUDIO_RATE, start
        container.mux(stream.encode(frame))
    container.mux(stream.encode())


def _pelvis(rest: Float[Array, "3"], root: Float[Array, "3"]) -> Float[Array, "3"]:
    return rest + root
