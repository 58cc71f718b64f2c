"""Faces and hands are solved as captures and pages solve them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.live_expressions import ExpressionSolver, FaceAndHands, page_times
from scene.expression import EXPRESSION_COUNT, EXPRESSION_NAMES


def test_a_real_face_and_hands_are_solved_and_a_mouth_that_opens_is_seen():
    seen, solver = FaceAndHands.of_a_person(), ExpressionSolver()
    jaw, at_rest = EXPRESSION_NAMES.index("jaw_open"), np.zeros(0)
    for frame in range(10):
        at_rest = solver.step(seen, frame / 30.0)
    assert at_rest.shape == (EXPRESSION_COUNT,)
    assert ((at_rest >= 0.0) & (at_rest <= 1.0)).all()
    face = seen.face.copy()
    face[14, 1] += 0.3 * np.linalg.norm(face[33] - face[263])  # the lower lip
    opened = FaceAndHands(face, seen.hands)
    shown = np.zeros(0)
    for frame in range(10, 20):
        shown = solver.step(opened, frame / 30.0)
    assert shown[jaw] > at_rest[jaw] + 0.4


def test_a_face_that_is_too_small_is_refused():
    seen = FaceAndHands.of_a_person()
    with pytest.raises(ValueError, match="large enough"):
        ExpressionSolver().step(FaceAndHands(0.01 * seen.face, seen.hands), 0.0)


@pytest.mark.e2e
def test_a_page_solves_them_too():
    times = page_times()
    assert 0.0 < times["p50_ms"] <= times["p95_ms"]
