"""Splats that were never seen borrow colour: from their mirror image, else from the nearest."""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import COLOUR, PARAMETERS
from renderer.splats.unseen import fill_unseen


def splats(*rows: tuple[float, float, float, float]) -> np.ndarray:
    """x, y, z and a shade of grey each."""
    parameters = np.zeros((len(rows), PARAMETERS), np.float32)
    for i, (x, y, z, grey) in enumerate(rows):
        parameters[i, :3], parameters[i, COLOUR : COLOUR + 3] = (x, y, z), grey
    return parameters


def test_the_mirror_image_comes_before_the_nearest():
    first = splats((0.3, 1.0, 0.0, 0.5), (-0.3, 1.01, 0.0, 0.1), (0.32, 1.0, 0.0, 0.9))
    filled = fill_unseen(first, np.array([False, True, True]))
    assert filled[0, COLOUR] == np.float32(0.1)


def test_without_a_mirror_image_the_nearest_gives():
    first = splats((0.3, 1.0, 0.0, 0.5), (0.0, 0.2, 0.0, 0.1), (0.35, 1.0, 0.1, 0.9))
    filled = fill_unseen(first, np.array([False, True, True]))
    assert filled[0, COLOUR] == np.float32(0.9)


def test_shape_and_opacity_stay_and_so_do_the_seen():
    learnt = splats((0.9, 9.0, 9.0, 0.7), (0.01, 1.0, 0.0, 0.2))
    filled = fill_unseen(learnt, np.array([False, True]))
    np.testing.assert_array_equal(filled[:, :COLOUR], learnt[:, :COLOUR])
    np.testing.assert_array_equal(filled[1], learnt[1])
    assert filled[0, COLOUR] == np.float32(0.2)


def test_nothing_changes_when_all_or_none_were_seen():
    learnt = splats((0.9, 9.0, 9.0, 0.7))
    for seen in (True, False):
        assert fill_unseen(learnt, np.array([seen])) is learnt
