"""Raw footage of the training camera: as a real camera records it, with a room behind the person.

A sequence holds the person alone, without noise; footage is the input of a capture.
"""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import cv2
import numpy as np

from capture.errors import CaptureError
from capture.studio.room import room_background
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera

if TYPE_CHECKING:
    from av.video.stream import VideoStream

BACKGROUNDS = ("black", "textured")
VIDEOS = (".mp4", ".mov", ".mkv")
_NEAR_LOSSLESS = {"crf": "4", "preset": "veryfast"}


@dataclass(frozen=True)
class Footage:
    """Where the raw training frames go, and the camera's imperfections.

    Frame i of the footage is training frame i of the sequence, whose pose and camera are exact.
    Raises CaptureError for numbers out of range.
    """

    path: Path
    """A video (.mp4, .mov, .mkv: H264 at 4:4:4, near lossless) or a folder of PNG frames."""
    background: str = "black"
    """`black`, or `textured`: a room with furniture, fixed in the world, drawn from the seed."""
    noise: float = 0.0
    """Sensor noise: standard deviation in 8-bit levels; 2 is a good camera, 8 a bad one."""
    blur_px: float = 0.0
    """The lens' blur: standard deviation of a Gaussian, px; 0.5 is sharp, 2 is out of focus."""
    shutter: float = 0.0
    """Motion blur: share of a frame's time that the shutter is open; 0.5 is usual."""

    def __post_init__(self) -> None:
        if self.background not in BACKGROUNDS:
            raise CaptureError(
                f"background must be one of {', '.join(BACKGROUNDS)}; got {self.background!r}"
            )
        for name, value, most in (
            ("noise", self.noise, 64.0),
            ("blur_px", self.blur_px, 32.0),
            ("shutter", self.shutter, 1.0),
        ):
            if not 0.0 <= value <= most:
                raise CaptureError(f"{name} must be between 0 and {most:g}; got {value}")
        if self.path.suffix and self.path.suffix.lower() not in VIDEOS:
            raise CaptureError(
                f"footage must be a video ({', '.join(VIDEOS)}) or a folder for PNG frames; "
                f"got {self.path.name}"
            )
        if self.path.exists():
            raise CaptureError(
                f"footage must not exist yet; got {self.path}; remove it or choose another"
            )


class FootageWriter:
    """Writes the footage of one camera. A context: the file appears whole, or not at all."""

    def __init__(
        self, footage: Footage, camera: Camera, frames_per_second: float, seed: int
    ) -> None:
        self._footage = footage
        self._rate = frames_per_second
        self._rng = np.random.default_rng([seed, 0xF117])
        textured = footage.background == "textured"
        size = (camera.height, camera.width, 3)
        self._room = room_background(camera, seed) if textured else np.zeros(size, np.float32)

    def __enter__(self) -> FootageWriter:
        target = self._footage.path
        target.parent.mkdir(parents=True, exist_ok=True)
        self._building = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
        self._frames: _Video | _Pictures
        if target.suffix:
            self._frames = _Video(self._building / target.name, self._rate)
        else:
            self._frames = _Pictures(self._building / target.name)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._frames.close()
        if error is None:
            (self._building / self._footage.path.name).rename(self._footage.path)
        shutil.rmtree(self._building, ignore_errors=True)

    def add(self, image: Float[Array, "H W 3"], alpha: Float[Array, "H W"]) -> None:
        """The next frame: `image` (sRGB, premultiplied) in front of the room, then the camera."""
        seen = image + (1.0 - alpha[..., None]) * self._room
        if self._footage.blur_px > 0.0:
            seen = cv2.GaussianBlur(seen, (0, 0), self._footage.blur_px)
        levels = 255.0 * seen + self._rng.normal(0.0, self._footage.noise, seen.shape)
        self._frames.write(np.clip(levels + 0.5, 0.0, 255.0).astype(np.uint8))


class _Video:
    def __init__(self, path: Path, rate: float) -> None:
        import av  # here alone: a machine that trains and draws may have no codecs

        self._container = av.open(str(path), "w")
        self._rate = Fraction(rate).limit_denominator(1001)
        self._stream: VideoStream | None = None

    def write(self, picture: UInt8[Array, "H W 3"]) -> None:
        if self._stream is None:
            self._stream = self._container.add_stream(
                "libx264", rate=self._rate, options=_NEAR_LOSSLESS
            )
            self._stream.height, self._stream.width = picture.shape[:2]
            self._stream.pix_fmt = "yuv444p"  # 4:2:0 would blur the colours of outlines
        from av import VideoFrame

        frame = VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        if self._stream is not None:
            self._container.mux(self._stream.encode())
        self._container.close()


class _Pictures:
    def __init__(self, folder: Path) -> None:
        self._folder, self._count = folder, 0
        folder.mkdir()

    def write(self, picture: UInt8[Array, "H W 3"]) -> None:
        data = cv2.imencode(".png", picture[..., ::-1])[1]
        (self._folder / f"{self._count:06d}.png").write_bytes(data.tobytes())
        self._count += 1

    def close(self) -> None:
        """Every picture is written already."""
