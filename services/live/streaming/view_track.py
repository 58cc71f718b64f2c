"""A viewer's own video: the newest pose and the newest camera in, one coded picture out.

Work is dropped, never queued. Drawing and encoding take turns in one thread for all viewers: every
core works on one picture, which goes to the encoder without being copied. Viewers with the same
viewpoint at the same tick share a picture; each has an encoder of their own, so that a key frame
requested by one is sent to nobody else.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np
from aiortc import MediaStreamTrack
from av import Packet, VideoFrame

from renderer.performer_model import PerformerModel
from renderer.scene_renderer import SceneRenderer
from renderer.splats.levels.detail import ViewDetail
from scene.arrays import Array, Bool, UInt8
from scene.camera import Camera
from scene.environment import Scene
from services.live.packets import NewestView
from services.live.room import Room
from services.live.streaming.encoding import BitrateSteps, PictureEncoder
from services.live.streaming.instrumentation import Instrumentation, PictureTimes
from services.live.streaming.pacing import (
    TICK_S,
    DetailGovernor,
    FramePacer,
    ResendBudget,
    SizeGovernor,
)
from services.live.streaming.yuv_planes import plane_rows

_SMALLEST_PX, _LARGEST_PX = 128, 1024
_DEFAULT_SIZE = (512, 512)
_BLOCK_PX = 16
"""Video is coded in macroblocks of 16 x 16; other sizes would be padded by the encoder."""
_KEY_FRAME_INTERVAL_S = 0.3
"""Least time between two key frames: a connection that lost one loses several in a row sooner."""
_STALL_INTERVAL_S = 0.5
"""Least time between two key frames sent because the viewer's picture stalls."""


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


class SharedPictures:
    """What has been drawn of one room at the newest tick."""

    def __init__(self, room: Room, instrumentation: Instrumentation) -> None:
        self.room, self._instrumentation = room, instrumentation
        self.work_s = 0.0
        """Time spent on pictures of this room so far, s."""
        self._tick = -1
        self._scenes: dict[bool, Scene[PerformerModel]] = {}
        self._frames: dict[tuple[bool, int, int, bytes], VideoFrame] = {}

    def begin(self, now_s: float) -> PictureTimes | None:
        """A picture is about to be drawn; see `Instrumentation.begin_picture`."""
        return self._instrumentation.begin_picture(self.room, now_s)

    def frame(
        self, renderer: FrameRenderer, tick: int, now_s: float, camera: Camera, *, hide_unseen: bool
    ) -> VideoFrame:
        """The room at `tick` (now), seen by `camera`; drawn by `renderer` unless it has been."""
        if tick != self._tick:
            self._tick = tick
            self._scenes.clear()
            self._frames.clear()
        if hide_unseen not in self._scenes:
            self._scenes[hide_unseen] = self.room.scene_at(
                now_s, hide_unseen=hide_unseen, live_look=True
            )
        view = camera.world_to_camera.tobytes() + camera.intrinsics.tobytes()
        key = (hide_unseen, camera.width, camera.height, view)
        if key not in self._frames:
            frame = renderer.render(self._scenes[hide_unseen], camera)
            self._instrumentation.on_picture(self.room, frame)
            self._frames[key] = frame
        return self._frames[key]


class ViewTrack(MediaStreamTrack):
    """What one viewer sees of a room, drawn and coded."""

    kind = "video"

    def __init__(
        self,
        pictures: SharedPictures,
        view: NewestView,
        encoder: PictureEncoder,
        executor: Executor,
        clock: Callable[[], float],
    ) -> None:
        super().__init__()
        self.render_seconds: deque[float] = deque(maxlen=300)
        """Time to draw and encode each of the last pictures, s, for the metrics."""
        self.bitrate = BitrateSteps()
        self._pictures, self._view, self._encoder = pictures, view, encoder
        self._executor, self._clock = executor, clock
        self._renderer = FrameRenderer()
        self._pacer, self._governor = FramePacer(), SizeGovernor()
        self._detail_governor = DetailGovernor(self._renderer.detail)
        self._resends = ResendBudget()
        self._key_frame_requested = False
        self._key_frame_s, self._stall_s = -_KEY_FRAME_INTERVAL_S, -_STALL_INTERVAL_S

    @property
    def wanted(self) -> bool:
        """Whether pictures are to come; none are drawn, coded or sent while not."""
        return self._view.wants_pictures

    def request_key_frame(self) -> None:
        """Have the next picture encoded as a key frame."""
        self._key_frame_requested = True

    def worth_resending(self, lost: Sequence[int]) -> list[int]:
        """Which of the packets `lost` (sequence numbers) to send again: the last ones, if any."""
        if not self.wanted:
            return []
        count = self._resends.take(self._clock(), len(lost), self.bitrate.bitrate)
        return list(lost[len(lost) - count :])

    async def recv(self) -> Packet:
        """The next picture, drawn when it is due (30 a second) from the newest state.

        None comes while the viewer draws the room or goes on with sound alone: nothing is drawn,
        coded or sent then.
        """
        if not self.wanted:
            # whoever draws by themselves may do so for hours
            self._encoder.release()
            self._renderer.release()
        while not self.wanted:
            self._governor.pause()
            self._detail_governor.pause()
            # a connection that was too slow has lost what the next picture would build on
            self.request_key_frame()
            await asyncio.sleep(TICK_S)
        while (wait_s := self._pacer.wait_s(self._clock())) > 0.0:
            await asyncio.sleep(wait_s)
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._executor, self._encode)

    def _encode(self) -> Packet:
        started = self._clock()
        tick = self._pacer.begin(started)
        packet = self._view.packet
        hide_unseen = packet is not None and packet.hide_unseen
        times = self._pictures.begin(started)
        frame = self._pictures.frame(
            self._renderer, tick, started, self._camera(), hide_unseen=hide_unseen
        )
        if times is not None:
            times.drawn(self._clock())
        key = self._key_due(started)
        coded = self._encoder.encode(frame, tick, self.bitrate.bitrate, key=key)
        done = self._clock()
        if times is not None:
            times.coded(done, frame.width, frame.height)
        self.render_seconds.append(done - started)
        self._pictures.work_s += done - started
        self._detail_governor.add_picture(done, self._pictures.work_s, self._governor.scale)
        self._governor.add_picture(done, done - started, self._pictures.work_s)
        return coded

    def _key_due(self, now_s: float) -> bool:
        self._key_frame_requested |= self._stalled(now_s)
        if not self._key_frame_requested or now_s - self._key_frame_s < _KEY_FRAME_INTERVAL_S:
            return False
        self._key_frame_requested, self._key_frame_s = False, now_s
        return True

    def _stalled(self, now_s: float) -> bool:
        """Whether the viewer reports a stalled picture, and was not helped just now."""
        packet = self._view.packet
        if packet is None or not packet.stalled or now_s - self._stall_s < _STALL_INTERVAL_S:
            return False
        self._stall_s = now_s
        return True

    def _camera(self) -> Camera:
        packet, scale = self._view.packet, self._governor.scale
        if packet is None:
            return self._pictures.room.initial_camera(*_DEFAULT_SIZE)
        return packet.camera(*frame_size(packet.width, packet.height, scale))


def write_yuv420(
    picture: UInt8[Array, "H W 3"], changed: Bool[Array, "bH bW"], frame: VideoFrame
) -> None:
    """Write `picture` (sRGB) into the planes of a yuv420p `frame`, where blocks have `changed`.

    Going through an RGB frame would copy it and have the encoder convert it on one core.
    """
    from renderer.compositing.yuv_kernels import to_yuv420  # numba takes a second

    to_yuv420(picture, changed, *(plane_rows(plane) for plane in frame.planes))


def frame_size(width: int, height: int, scale: float = 1.0) -> tuple[int, int]:
    """The size to draw for a viewer who asks for `width` x `height` px, `scale` of its sides.

    Aspect kept, the longest side at most 1024 px before it is scaled, both sides multiples of 16
    and at least 128 px.
    """
    if width < 1 or height < 1:
        return _DEFAULT_SIZE
    scale *= min(1.0, _LARGEST_PX / max(width, height))
    sides = (
        max(_SMALLEST_PX, round(side * scale / _BLOCK_PX) * _BLOCK_PX) for side in (width, height)
    )
    wide, high = sides
    return wide, high
