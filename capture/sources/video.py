"""Video files: what is in them, and an even sample of their frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from av.video.frame import VideoFrame

from capture.errors import CaptureStopped, UnreadableClip
from scene.arrays import Array, Float, UInt8

MAX_FRAMES = 120
"""Frames used of a clip: more of them teach the model little and cost time."""
MAX_SIDE_PX = 1024
"""Frames are made smaller to this longest side: the landmark network sees 256 px of a person."""
Window = tuple[slice, slice]
"""Rows and columns of a picture as it was filmed, px."""
WHOLE: Window = (slice(None), slice(None))
MAX_PIXELS = 8192 * 8192
"""A picture that claims more is refused before it is decoded."""
_FASTEST, _USUAL_RATE = 240.0, 30.0
"""Frames a second that cameras film at most, and that a clip is believed to have that claims more:
its time stamps were never set."""
_MAX_PACKETS = 200_000
"""About an hour at 60 frames/s: a longer clip is no enrolment."""


@dataclass(frozen=True, eq=False)
class Clip:
    """Frames of one fixed camera, in time order."""

    images: tuple[UInt8[Array, "H W 3"], ...]
    """sRGB, all of one size."""
    times_s: Float[Array, "F"]
    """From the first frame of the clip, increasing."""
    source_size: tuple[int, int]
    """Width and height of the frames before they were cut or made smaller, px."""
    source_frames: int
    """Frames of the whole clip, from which these were sampled."""
    recordings: int = 1
    """Of which the clip is made; between two the picture may jump."""

    @property
    def frames_per_second(self) -> float:
        """Rate of the sampled frames."""
        span = float(self.times_s[-1] - self.times_s[0])
        return (len(self.times_s) - 1) / span if span > 0.0 else 30.0


@dataclass(frozen=True)
class VideoInfo:
    """What a video file holds."""

    width: int
    height: int
    frames: int
    frames_per_second: float


def probe_video(path: Path) -> VideoInfo:
    """Size, frames and rate of the first video stream; decodes nothing.

    Raises UnreadableClip for anything that is no video.
    """
    with _opened(path) as container:
        stream = container.streams.video[0]
        if stream.width * stream.height > MAX_PIXELS:
            raise UnreadableClip(
                f"a frame of {path.name} must have at most {MAX_PIXELS} pixels; got "
                f"{stream.width} x {stream.height}; export it smaller"
            )
        frames = 0
        for packet in container.demux(stream):
            frames += packet.size > 0
            if frames > _MAX_PACKETS:
                raise UnreadableClip(
                    f"{path.name} must have at most {_MAX_PACKETS} frames; got more; cut it to "
                    "the 10 to 30 seconds that show the person"
                )
        rate = stream.average_rate or stream.guessed_rate
        believed = float(rate) if rate and rate <= _FASTEST else _USUAL_RATE
        return VideoInfo(stream.width, stream.height, frames, believed)


def read_video(
    path: Path,
    *,
    max_frames: int = MAX_FRAMES,
    max_side: int = MAX_SIDE_PX,
    window: Window = WHOLE,
    on_progress: Callable[[float], None] = lambda _: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Clip:
    """At most `max_frames` frames, spread evenly over the clip, turned the way they are shown.

    Each is cut to `window` and made no larger than `max_side`.

    Raises UnreadableClip for anything that is no video, CaptureStopped when asked to stop.
    """
    info = probe_video(path)
    wanted = set(evenly_spaced(info.frames, max_frames).tolist())
    images: list[Array] = []
    times: list[float] = []
    numbers: list[int] = []
    size, decoded = (info.width, info.height), 0
    with _opened(path) as container:
        for decoded, frame in enumerate(_decoded(container, path), start=1):
            if should_stop():
                raise CaptureStopped("capture was stopped while reading the clip")
            on_progress(decoded / max(info.frames, 1))
            if decoded - 1 not in wanted:
                continue
            picture = np.rot90(frame.to_ndarray(format="rgb24"), round(frame.rotation / 90.0))
            size = (picture.shape[1], picture.shape[0])
            images.append(shrink(picture[window], max_side))
            time_s = frame.time if frame.time is not None else decoded / info.frames_per_second
            times.append(float(time_s))
            numbers.append(decoded - 1)
    if not images:
        raise UnreadableClip(f"{path.name} must hold at least one frame; got none; film it again")
    return Clip(tuple(images), increasing(times, numbers, info.frames_per_second), size, decoded)


@dataclass(frozen=True, eq=False)
class FilmedFrame:
    """A frame of a clip that plays."""

    time_s: float
    """From the first frame of the clip."""
    frame: VideoFrame

    def image(self, max_side: int = MAX_SIDE_PX) -> UInt8[Array, "H W 3"]:
        """sRGB, turned the way it is shown, no larger than `max_side`. Of those alone that are
        looked at: converting takes longer than decoding."""
        turns = round(self.frame.rotation / 90.0)
        return shrink(np.rot90(self.frame.to_ndarray(format="rgb24"), turns), max_side)


def played_frames(path: Path) -> Iterator[FilmedFrame]:
    """Every frame of a clip of any length, in order, as it is decoded.

    Raises UnreadableClip for anything that is no video.
    """
    info = probe_video(path)
    with _opened(path) as container:
        first_s, last_s = None, -1.0
        for number, frame in enumerate(_decoded(container, path)):
            told_s = number / info.frames_per_second if frame.time is None else float(frame.time)
            first_s = told_s if first_s is None else first_s
            if told_s - first_s > last_s:
                last_s = told_s - first_s
                yield FilmedFrame(last_s, frame)


def evenly_spaced(count: int, at_most: int) -> Array:
    """At most `at_most` indices of `count`, evenly spaced from the first to the last."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, at_most)).round().astype(int))


def shrink(picture: UInt8[Array, "H W 3"], max_side: int) -> UInt8[Array, "h w 3"]:
    """`picture` no larger than `max_side`, box-filtered; itself if it is small enough."""
    height, width = picture.shape[:2]
    scale = max_side / max(height, width)
    if scale >= 1.0:
        return np.ascontiguousarray(picture)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def increasing(
    times_s: list[float], numbers: list[int], frames_per_second: float
) -> Float[Array, "F"]:
    """Times from 0 of the frames `numbers`; broken time stamps (repeated, going back, closer than
    any camera films) give way to an even rate."""
    times, counted = np.asarray(times_s) - times_s[0], np.asarray(numbers) - numbers[0]
    steps = np.diff(times)
    if (steps <= 0.0).any() or (np.diff(counted) > _FASTEST * steps).mean() > 0.5:
        return counted / frames_per_second
    return times


@contextmanager
def _opened(path: Path) -> Iterator[InputContainer]:
    if not path.is_file():
        raise UnreadableClip(f"the clip must be a file; got none at {path}; look at its name")
    try:
        container = av.open(str(path))
    except (FFmpegError, OSError, ValueError) as error:
        raise _no_video(path, error) from error
    with container:
        if not container.streams.video:
            raise _no_video(path, "no picture in it")
        yield container


def _decoded(container: InputContainer, path: Path) -> Iterator[VideoFrame]:
    container.streams.video[0].thread_type = "AUTO"
    frames = container.decode(video=0)
    decoded = 0
    while True:
        try:
            frame = next(frames)
        except StopIteration:
            return
        except FFmpegError as error:
            if decoded:  # a clip cut short by a crash: what came before is good
                return
            raise _no_video(path, error) from error
        decoded += 1
        yield frame


def _no_video(path: Path, why: object) -> UnreadableClip:
    return UnreadableClip(
        f"{path.name} must be a video that FFmpeg can read (mp4, mov, webm, mkv); got "
        f"{path.stat().st_size} bytes "
        f"({why}); export it again as mp4"
    )
