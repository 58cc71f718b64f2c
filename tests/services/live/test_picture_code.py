"""The code of a sent picture: the same bits as the page writes, and what is no code."""

from __future__ import annotations

import numpy as np
import pytest
from av import CodecContext, Packet
from hypothesis import given
from hypothesis import strategies as st

from services.live.cell_code import draw_cells
from services.live.look.picture_code import SIDE_PX, PictureCode, cells_of, code_in, read
from services.live.look.receiver import PICTURE_PX
from tests.services.live.look_pictures import Encoder, frame_of

CODE = PictureCode(12345, -12, 34, 400)
GOLDEN = "30397f4822190930000000"
"""The same as in client/tests/look/pictureCode.test.ts."""

codes = st.builds(
    PictureCode,
    st.integers(0, 65535),
    st.integers(-2048, 2047),
    st.integers(-2048, 2047),
    st.integers(1, 4095),
)


def test_golden_cells():
    assert np.packbits(cells_of(CODE).ravel()).tobytes().hex() == GOLDEN


@given(codes)
def test_what_was_written_is_read(code):
    luma = draw_cells(cells_of(code))
    assert luma.shape == (SIDE_PX, SIDE_PX)
    assert set(np.unique(luma)) <= {16, 235}
    assert read(luma) == code


@given(codes, st.integers(0, 80))
def test_one_wrong_cell_is_noticed(code, cell):
    cells = cells_of(code)
    cells.flat[cell] ^= True
    assert code_in(cells) is None


@pytest.mark.parametrize("shade", [0, 255])
def test_a_plain_corner_is_no_code(shade):
    assert read(np.full((SIDE_PX, SIDE_PX), shade, np.uint8)) is None


def test_codes_are_read_from_rough_pictures_at_the_lowest_bitrate():
    rng = np.random.default_rng(1)
    rough = np.kron(rng.integers(0, 255, (96, 96, 3), np.uint8), np.ones((4, 4, 1), np.uint8))
    encoder, decoder = Encoder(), CodecContext.create("libvpx", "r")
    for number in range(15):
        code = PictureCode(66 * number, 4 * number - 20, 10, 300 + number)
        data = encoder.encode(frame_of(code, np.roll(rough, 7 * number, axis=1)))
        (frame,) = decoder.decode(Packet(data))
        shown = frame.to_ndarray(format="rgb24")[PICTURE_PX:, :SIDE_PX, 1]
        assert read(shown) == code
