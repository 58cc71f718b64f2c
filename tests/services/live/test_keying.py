"""A picture that is its own matte: what is lifted off black comes back, also by way of VP8."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from services.live.look.keying import lifted, lowered


@given(st.integers(0, 255), st.integers(0, 255), st.integers(0, 255))
def test_whoever_is_there_comes_back_in_their_colours_however_dark(red, green, blue):
    rgb = np.full((2, 2, 3), (red, green, blue), np.uint8)
    back, matte = lowered(lifted(rgb, np.ones((2, 2), np.float32)))
    assert np.abs(back.astype(int) - rgb).max() <= 1
    assert (matte == 255).all()


def test_where_nobody_is_nothing_is_sent_and_nobody_comes_back():
    bright = np.full((3, 3, 3), 255, np.uint8)
    nothing = lifted(bright, np.zeros((3, 3), np.float32))
    assert not nothing.any()
    assert not lowered(nothing)[1].any()
    # what a coder makes of black beside an edge
    assert not lowered(nothing + np.uint8(12))[1].any()


def test_the_matte_rises_from_the_edge_inwards():
    kept = np.linspace(0.0, 1.0, 21, dtype=np.float32)[None]
    for shade in (0, 128, 255):
        _, matte = lowered(lifted(np.full((1, 21, 3), shade, np.uint8), kept))
        assert (np.diff(matte[0].astype(int)) >= 0).all()
        assert matte[0, 0] == 0
        assert matte[0, -5:].min() == 255
