"""Who looks from one place shares a picture, and what is drawn anew is whole."""

from __future__ import annotations

import numpy as np
import pytest
from av import VideoFrame

from scene import Camera
from services.live.rendering.drawing import FrameRenderer, RoomPictures
from services.live.room import MeetingPerformer, Room
from services.live.streaming import latency_code
from services.live.streaming.pictures import PictureOrder
from services.live.streaming.yuv_planes import plane_rows
from tests.renderer.studio import make_model, make_motion

CAPTURED_MS = 1.7e12 + 4321.0


@pytest.fixture
def room() -> Room:
    ada = MeetingPerformer("p", "Ada", make_model(), make_motion(20), (0.0, 0.0, 0.0), 0.0)
    return Room("m", (ada,))


def drawn(
    pictures: RoomPictures,
    renderer: FrameRenderer,
    room: Room,
    tick: int,
    camera: Camera,
    *,
    now_s: float = 0.0,
    hide_unseen: bool = False,
    stamp_ms: float | None = None,
) -> VideoFrame:
    order = PictureOrder(tick, now_s, camera, hide_unseen, 1.0, 2_500_000, False, stamp_ms)
    return pictures.frame(renderer, order, lambda: room.scene_at(now_s, hide_unseen=hide_unseen))


def test_who_looks_from_one_place_at_one_instant_shares_a_picture(room):
    shared = RoomPictures()
    camera, other = room.initial_camera(128, 128), room.initial_camera(144, 128)
    one, two = FrameRenderer(), FrameRenderer()
    frame = drawn(shared, one, room, 1, camera)
    assert drawn(shared, two, room, 1, room.initial_camera(128, 128), now_s=0.01) is frame
    assert drawn(shared, two, room, 1, other) is not frame
    assert drawn(shared, two, room, 1, camera, hide_unseen=True) is not frame
    assert drawn(shared, two, room, 2, camera) is not frame


def test_a_renderer_that_was_left_out_for_a_while_shows_the_whole_picture(room):
    """What it holds is older than what others saw; only its own last picture counts."""
    camera, mine, fresh = room.initial_camera(160, 128), FrameRenderer(), FrameRenderer()
    shared = RoomPictures()
    for tick, renderer in enumerate((mine, fresh, fresh, mine)):
        seen = drawn(shared, renderer, room, tick, camera, now_s=0.3 * tick)
    whole = FrameRenderer().render(room.scene_at(0.9), camera)
    for ours, theirs in zip(seen.planes, whole.planes, strict=True):
        difference = (
            plane_rows(ours)[:, : ours.width].astype(int) - plane_rows(theirs)[:, : ours.width]
        )
        assert np.abs(difference).max() <= 2


def test_a_picture_shows_the_capture_time_that_is_ordered(room):
    shared, camera = RoomPictures(), room.initial_camera(256, 256)
    plain = drawn(shared, FrameRenderer(), room, 1, camera)
    assert latency_code.read(plane_rows(plain.planes[0])) is None
    stamped = drawn(shared, FrameRenderer(), room, 2, camera, stamp_ms=CAPTURED_MS)
    assert latency_code.read(plane_rows(stamped.planes[0])) == int(CAPTURED_MS) % 65536
