"""The contact sheet shows each view where its caption says, and errors in their colours."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.evaluation.contact_sheet import CAPTION_PX, CELL_PX, contact_sheet, error_colours
from renderer.evaluation.evaluate import EvaluatedView
from scene.errors import InvalidInput


def judged(index: int, truth: float, made: float) -> EvaluatedView:
    pictures = [np.full((40, 60, 3), value, np.float32) for value in (truth, made)]
    return EvaluatedView("novel_view", index, *pictures, crop=(slice(10, 30), slice(20, 40)))


def test_cells_hold_truth_model_and_error_under_their_caption():
    views = [judged(index, 0.5, 0.5 + 0.05 * index) for index in range(6)]
    sheet, captions = contact_sheet(views)
    assert [c.text for c in captions][:3] == [
        "novel view 0: 100.0 dB",
        "novel view 1: 26.0 dB",
        "novel view 2: 20.0 dB",
    ]
    assert len({(c.x, c.y) for c in captions}) == 6
    for place, caption in enumerate(captions):
        top, left = caption.y + 6, caption.x
        cells = [
            sheet[top : top + CELL_PX, left + n * CELL_PX : left + (n + 1) * CELL_PX]
            for n in range(3)
        ]
        assert sheet[top - CAPTION_PX, left, 0] != pytest.approx(0.5)  # paper
        np.testing.assert_allclose(cells[0], 0.5, atol=1e-6)
        np.testing.assert_allclose(cells[1], 0.5 + 0.05 * place, atol=1e-6)
        wanted = error_colours(np.full((1, 1), 0.05 * place))
        np.testing.assert_allclose(cells[2][80, 80], wanted[0, 0], atol=1e-5)


def test_a_crop_that_is_no_square_stands_in_the_middle_of_black():
    view = EvaluatedView(
        "unseen_pose",
        0,
        *2 * (np.ones((40, 60, 3), np.float32),),
        crop=(slice(0, 40), slice(10, 30)),
    )
    sheet, (caption,) = contact_sheet([view])
    row = sheet[caption.y + 6 + CELL_PX // 2, caption.x : caption.x + CELL_PX, 0]
    assert row[: CELL_PX // 4 - 2].max() == 0.0
    assert row[CELL_PX // 4 + 2 : 3 * CELL_PX // 4 - 2].min() == pytest.approx(1.0)
    assert row[3 * CELL_PX // 4 + 2 :].max() == 0.0


def test_errors_go_through_black_red_yellow_white():
    shown = error_colours(np.array([[0.0, 0.25 / 3, 0.5 / 3, 0.25, 1.0]]))[0]
    np.testing.assert_allclose(
        shown, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 1, 1]], atol=1e-5
    )


def test_nothing_to_show_is_refused():
    with pytest.raises(InvalidInput, match="at least one view; got none"):
        contact_sheet([])
