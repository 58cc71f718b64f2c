"""What leaves for live look is the person, and what the server makes of it."""

from __future__ import annotations

import numpy as np

from services.joining.cut_out import CutOut, matte_of
from services.joining.look_track import LookTrack
from services.joining.window import Square
from services.live.look.keying import lowered
from services.live.look.picture_code import SIDE_PX, read
from services.live.look.receiver import PICTURE_PX, key_frame_size, picture_of
from tests.services.joining.people import SIZE, somebody

PERSON, ROOM = (200, 90, 40), (20, 250, 20)


def picture() -> np.ndarray:
    seen = somebody()
    image = np.full((SIZE[1], SIZE[0], 3), ROOM, np.uint8)
    image[seen.mask > 0.5] = PERSON
    return image


def test_the_room_is_black_before_anything_is_encoded():
    frame = CutOut().draw(picture(), somebody(), 70_000.0)
    assert frame is not None
    rgb, matte = lowered(frame[:PICTURE_PX])
    assert 0.1 < (matte == 0).mean() < 0.9
    assert not frame[:PICTURE_PX][matte == 0].any()
    assert np.abs(np.median(rgb[matte == 255], axis=0) - PERSON).max() <= 1
    code = read(frame[PICTURE_PX:, :SIDE_PX, 1])
    assert code is not None
    assert code.captured_ms == 70_000 - 65_536


def test_ten_a_second_leave():
    cut_out = CutOut()
    times_ms = 1e3 * np.arange(60) / 30.0
    drawn = [cut_out.draw(picture(), somebody(), float(time_ms)) for time_ms in times_ms]
    assert sum(one is not None for one in drawn) == 20


def test_a_matte_shows_a_square_of_the_mask_and_nothing_of_what_hardly_is_the_person():
    # as in client/tests/look/matte.test.ts
    mask = np.tile(np.array([1, 1, 1, 0.5, 0.05, 0.05, 0, 0], np.float32), (4, 1))
    assert matte_of(mask, Square(0, 0, 4), 4)[0].tolist() == [255, 255, 255, 128]
    assert not matte_of(mask, Square(4, 0, 4), 4).any()
    beyond = matte_of(mask, Square(-2, -2, 4), 4).ravel().tolist()
    assert beyond[:8] == [0] * 8
    assert beyond[8:12] == [0, 0, 255, 255]
    assert matte_of(mask, Square(0, -1, 4), 2).ravel().tolist() == [255, 128, 255, 128]


async def test_the_track_sends_the_newest_picture_as_the_server_reads_it():
    import av

    clock = iter(np.arange(1000) / 10.0)
    track, cut_out, decoder = (
        LookTrack(lambda: float(next(clock))),
        CutOut(),
        av.CodecContext.create("libvpx", "r"),
    )
    for number in range(8):
        frame = cut_out.draw(picture(), somebody(), 100.0 * number)
        assert frame is not None
        if number == 5:
            track.request_key_frame()
        track.show(frame)
        packet = await track.recv()
        is_key = key_frame_size(bytes(packet)) is not None
        assert is_key == (number in (0, 5))
        (decoded,) = decoder.decode(packet)
        got = picture_of(decoded.to_ndarray(format="rgb24"))
        assert got is not None
        assert got.captured_ms == 100 * number
        inside = got.matte > 250
        assert np.abs(np.median(got.rgb[inside], axis=0) - PERSON).max() < 12
