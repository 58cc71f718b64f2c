"""Drawing and encoding the pictures of viewers, in whatever process does it; for one thread.

Every core works on one picture, which goes to the encoder without being copied. Viewers with the
same viewpoint at the same tick share a picture; each has an encoder of their own, so that a key
frame requested by one is sent to nobody else.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from av import VideoFrame

from renderer.performer_model import PerformerModel
from renderer.scene_renderer import SceneRenderer
from renderer.splats.levels.detail import ViewDetail
from scene.arrays import Array, Bool, UInt8
from scene.camera import Camera
from scene.environment import Scene
from services.live.streaming.encoding import PictureEncoder
from services.live.streaming.latency_code import write
from services.live.streaming.pacing import DetailGovernor
from services.live.streaming.pictures import CodedPicture, PictureOrder
from services.live.streaming.yuv_planes import plane_rows

SceneOf = Callable[[], Scene[PerformerModel]]
"""The room as an order wants it."""


class Workload:
    """What one thread has worked so far."""

    def __init__(self) -> None:
        self.worked_s = 0.0


class FrameRenderer:
    """Renders into a video frame that it keeps; each belongs to one viewer."""

    def __init__(self) -> None:
        self.detail = ViewDetail()
        self._renderer = SceneRenderer(self.detail)
        self._frame: VideoFrame | None = None

    def render(self, scene: Scene[PerformerModel], camera: Camera) -> VideoFrame:
        """`scene` seen by `camera`, as yuv420p; the frame is reused by the next call."""
        picture = self._renderer.render(scene, camera)
        changed = self._renderer.changed
        frame = self._frame
        if frame is None or (frame.width, frame.height) != (camera.width, camera.height):
            frame = self._frame = VideoFrame(camera.width, camera.height, "yuv420p")
            changed = np.ones_like(changed)
        write_yuv420(picture, changed, frame)
        return frame

    def release(self) -> None:
        """Give back the pictures that it keeps."""
        self._renderer, self._frame = SceneRenderer(self.detail), None


class RoomPictures:
    """What has been drawn of one room at the newest tick."""

    def __init__(self) -> None:
        self._tick = -1
        self._scenes: dict[bool, Scene[PerformerModel]] = {}
        self._frames: dict[tuple[bool, int, int, bytes], VideoFrame] = {}

    def frame(self, renderer: FrameRenderer, order: PictureOrder, scene_of: SceneOf) -> VideoFrame:
        """The room at the order's tick, seen by its camera; drawn by `renderer` unless it has
        been."""
        if order.tick != self._tick:
            self._tick = order.tick
            self._scenes.clear()
            self._frames.clear()
        if order.hide_unseen not in self._scenes:
            self._scenes[order.hide_unseen] = scene_of()
        camera = order.camera
        view = camera.world_to_camera.tobytes() + camera.intrinsics.tobytes()
        key = (order.hide_unseen, camera.width, camera.height, view)
        if key not in self._frames:
            frame = renderer.render(self._scenes[order.hide_unseen], camera)
            if order.stamp_ms is not None:
                write(frame, order.stamp_ms)
            self._frames[key] = frame
        return self._frames[key]


class ViewerDrawing:
    """Draws and encodes for one viewer."""

    def __init__(
        self, encoder: PictureEncoder, workload: Workload, clock: Callable[[], float]
    ) -> None:
        """`workload` is that of the thread that calls."""
        self._encoder, self._workload, self._clock = encoder, workload, clock
        self._renderer = FrameRenderer()
        self._governor = DetailGovernor(self._renderer.detail)

    def picture(
        self, pictures: RoomPictures, order: PictureOrder, scene_of: SceneOf
    ) -> CodedPicture:
        """The picture that is ordered, of the room whose `pictures` are given."""
        began_s = self._clock()
        frame = pictures.frame(self._renderer, order, scene_of)
        drawn_s = self._clock()
        packet = self._encoder.encode(frame, order.tick, order.bitrate, key=order.key)
        coded_s = self._clock()
        self._workload.worked_s += coded_s - began_s
        worked_s = self._workload.worked_s
        self._governor.add_picture(coded_s, worked_s, order.scale)
        return CodedPicture(
            packet, frame.width, frame.height, drawn_s - began_s, coded_s - drawn_s, worked_s
        )

    def release(self) -> None:
        """Give back what it holds; the next picture begins anew."""
        self._governor.pause()
        self._encoder.release()
        self._renderer.release()


def write_yuv420(
    picture: UInt8[Array, "H W 3"], changed: Bool[Array, "bH bW"], frame: VideoFrame
) -> None:
    """Write `picture` (sRGB) into the planes of a yuv420p `frame`, where blocks have `changed`.

    Going through an RGB frame would copy it and have the encoder convert it on one core.
    """
    from renderer.compositing.yuv_kernels import to_yuv420  # numba takes a second

    to_yuv420(picture, changed, *(plane_rows(plane) for plane in frame.planes))
