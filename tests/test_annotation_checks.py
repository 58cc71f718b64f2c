"""Who runs with the checker of array annotations: quick tests do, slow ones do not."""

from __future__ import annotations

import jaxtyping
import numpy as np
import pytest

from renderer.evaluation.metrics import psnr

_PICTURE = np.zeros((4, 4, 3), np.float32)
_OF_NO_CHANNEL = np.zeros((4, 4), np.float32)


def breaks_annotations() -> bool:
    """Whether a call is refused that works, and that annotations do not allow."""
    try:
        psnr(_OF_NO_CHANNEL, _OF_NO_CHANNEL)
    except jaxtyping.TypeCheckError:
        return True
    return False


@pytest.fixture(scope="module")
def refused_in_setup() -> bool:
    """Set up in the run of the slow test, which asks for it first."""
    return breaks_annotations()


@pytest.mark.slow
def test_a_slow_test_is_not_checked_nor_is_what_is_set_up_for_it(refused_in_setup: bool):
    assert not refused_in_setup
    assert not breaks_annotations()


@pytest.mark.slow
@pytest.mark.usefixtures("unchecked_annotations")
def test_a_slow_test_that_asks_for_no_check_ends_it_for_itself_alone():
    assert not breaks_annotations()


def test_a_quick_test_is_checked_after_slow_ones():
    psnr(_PICTURE, _PICTURE)
    assert breaks_annotations()


@pytest.mark.usefixtures("unchecked_annotations")
def test_a_quick_test_can_ask_for_no_check():
    assert not breaks_annotations()
