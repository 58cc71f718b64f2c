"""A viewer's own video: the newest pose and the newest camera in, one coded picture out.

When a picture is due, how large it is, whether it is a key frame and of which bitrate is decided
here; it is drawn and encoded by whatever `services.live.rendering` has for it. Work is dropped,
never queued: of each viewer one picture at most is on its way.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Sequence

from aiortc import MediaStreamTrack
from av import Packet
from prometheus_client import Counter, Histogram

from scene.camera import Camera
from services.live.aiortc_compat import MediaStreamError
from services.live.packets import NewestView
from services.live.room import Room
from services.live.streaming.encoding import BitrateSteps
from services.live.streaming.instrumentation import Instrumentation, PictureTimes
from services.live.streaming.pacing import TICK_S, FramePacer, ResendBudget, SizeGovernor
from services.live.streaming.pictures import (
    CodedPicture,
    PictureOrder,
    PictureRefused,
    ViewerPictures,
)

log = logging.getLogger(__name__)

_SMALLEST_PX, _LARGEST_PX = 128, 1024
_DEFAULT_SIZE = (512, 512)
_BLOCK_PX = 16
"""Video is coded in macroblocks of 16 x 16; other sizes would be padded by the encoder."""
_KEY_FRAME_INTERVAL_S = 0.3
"""Least time between two key frames: a connection that lost one loses several in a row sooner."""
_STALL_INTERVAL_S = 0.5
"""Least time between two key frames sent because the viewer's picture stalls."""
PICTURES = Counter("metanerf_pictures_total", "Pictures drawn and encoded for viewers.")
PICTURE_SECONDS = Histogram(
    "metanerf_picture_seconds",
    "Time to draw a picture, and to encode it, s.",
    ["step"],
    buckets=(0.002, 0.005, 0.01, 0.02, 0.033, 0.05, 0.1, 0.5),
)
MOTION_AGE_SECONDS = Histogram(
    "metanerf_motion_age_seconds",
    "Time from a motion's arrival to the first picture of each viewer that shows it, s.",
    buckets=(0.01, 0.02, 0.03, 0.04, 0.05, 0.075, 0.1, 0.2, 0.5, 1.0),
)
_REFUSED_S = 5.0
"""Until a room that could not be drawn is tried again: who is in it may have changed."""


class ViewTrack(MediaStreamTrack):
    """What one viewer sees of a room, drawn and coded."""

    kind = "video"

    def __init__(
        self,
        room: Room,
        pictures: ViewerPictures,
        view: NewestView,
        instrumentation: Instrumentation,
        clock: Callable[[], float],
    ) -> None:
        super().__init__()
        self.render_seconds: deque[float] = deque(maxlen=300)
        """Time to draw and encode each of the last pictures, s, for the metrics."""
        self.bitrate = BitrateSteps()
        self._room, self._pictures, self._view = room, pictures, view
        self._instrumentation, self._clock = instrumentation, clock
        self._pacer, self._governor = FramePacer(), SizeGovernor()
        self._times: PictureTimes | None = None
        """What notes how the picture goes on that is on its way."""
        self._shown_s: float | None = None
        """When the newest motion came that a picture has shown."""
        self._first_shown_s: float | None = None
        """When the motion came that the picture on its way is the first to show."""
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

    def stop(self) -> None:
        """End it: nothing is drawn any more."""
        super().stop()
        self._pictures.close()

    async def recv(self) -> Packet:
        """The next picture, drawn when it is due (30 a second) from the newest state.

        None comes while the viewer draws the room or goes on with sound alone: nothing is drawn,
        coded or sent then. Raises MediaStreamError once it was stopped.
        """
        while True:
            await self._until_due()
            try:
                return self._done(await self._pictures.picture(self._order))
            except PictureRefused as refusal:
                log.error("a viewer sees nothing: %s", refusal)
                await asyncio.sleep(_REFUSED_S)

    async def _until_due(self) -> None:
        if not self.wanted:
            # whoever draws by themselves may do so for hours
            self._pictures.rest()
        while not self.wanted:
            self._require_live()
            self._governor.pause()
            # a connection that was too slow has lost what the next picture would build on
            self.request_key_frame()
            await asyncio.sleep(TICK_S)
        while (wait_s := self._pacer.wait_s(self._clock())) > 0.0:
            await asyncio.sleep(wait_s)
        self._require_live()

    def _require_live(self) -> None:
        if self.readyState != "live":
            raise MediaStreamError

    def _order(self) -> PictureOrder:
        """The picture that is begun now, of the newest state."""
        now_s, packet, scale = self._clock(), self._view.packet, self._governor.scale
        tick = self._pacer.begin(now_s)
        self._times = self._instrumentation.begin_picture(self._room, now_s)
        self._note_motion()
        return PictureOrder(
            tick,
            now_s,
            self._camera(scale),
            packet is not None and packet.hide_unseen,
            scale,
            self.bitrate.bitrate,
            self._key_due(now_s),
            self._instrumentation.stamp_ms(self._room),
        )

    def _done(self, picture: CodedPicture) -> Packet:
        """What is sent of `picture`, which is noted."""
        now_s, own_s = self._clock(), picture.draw_s + picture.encode_s
        if self._times is not None:
            self._times.drawn(now_s - picture.encode_s)
            self._times.coded(now_s, picture.width, picture.height)
        PICTURES.inc()
        PICTURE_SECONDS.labels("draw").observe(picture.draw_s)
        PICTURE_SECONDS.labels("encode").observe(picture.encode_s)
        if self._first_shown_s is not None:
            MOTION_AGE_SECONDS.observe(now_s - self._first_shown_s)
        self.render_seconds.append(own_s)
        self._governor.add_picture(now_s, own_s, picture.worked_s)
        return picture.packet

    def _note_motion(self) -> None:
        """Note which motion the picture that is begun now is the first to show, if any."""
        newest_s = self._room.newest_arrival_s
        # what came before the first picture waited for no drawing
        new = self._shown_s is not None and newest_s > self._shown_s
        self._first_shown_s, self._shown_s = (newest_s if new else None), newest_s

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

    def _camera(self, scale: float) -> Camera:
        packet = self._view.packet
        if packet is None:
            return self._room.initial_camera(*_DEFAULT_SIZE)
        return packet.camera(*frame_size(packet.width, packet.height, scale))


def frame_size(width: int, height: int, scale: float = 1.0) -> tuple[int, int]:
    """The size to draw for a viewer who asks for `width` x `height` px, `scale` of its sides.

    Aspect kept, the longest side at most 1024 px before it is scaled, both sides multiples of 16
    and at least 128 px: where one would be less, both are larger.
    """
    if width < 1 or height < 1:
        return _DEFAULT_SIZE
    largest = _LARGEST_PX / max(width, height)
    scale = min(max(scale * min(1.0, largest), _SMALLEST_PX / min(width, height)), largest)
    # one side of what is longer than 8 to 1 is out of bounds at any scale
    sides = (
        max(_SMALLEST_PX, round(side * scale / _BLOCK_PX) * _BLOCK_PX) for side in (width, height)
    )
    wide, high = sides
    return wide, high
