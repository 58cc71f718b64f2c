"""Ticks and sizes by a clock of our own: the newest wins, work is dropped, sizes don't flutter."""

from __future__ import annotations

import pytest

from renderer.splats.levels.detail import FULL_DENSITY, LEAST_DENSITY, ViewDetail
from services.live.streaming.pacing import (
    SCALES,
    TICK_S,
    DetailGovernor,
    FramePacer,
    ResendBudget,
    SizeGovernor,
)


def test_a_viewer_gets_one_picture_a_tick():
    pacer, now_s, ticks = FramePacer(), 100.0, []
    for _ in range(60):
        now_s += pacer.wait_s(now_s)
        assert pacer.wait_s(now_s) == pytest.approx(0.0, abs=1e-9)
        ticks.append(pacer.begin(now_s))
        now_s += 0.004
    assert ticks == list(range(ticks[0], ticks[0] + 60))
    assert now_s == pytest.approx(100.0 + 59 * TICK_S, abs=TICK_S)


def test_what_is_late_begins_at_once_and_what_was_missed_is_dropped():
    pacer = FramePacer()
    first = pacer.begin(10.001)
    assert pacer.wait_s(10.001 + 3.4 * TICK_S) == 0.0
    assert pacer.begin(10.001 + 3.4 * TICK_S) == first + 3


def test_viewers_of_one_process_share_their_ticks():
    one, other = FramePacer(), FramePacer()
    assert one.begin(5.001) == other.begin(5.02)


def watch(governor: SizeGovernor, seconds: float, rate: float, cost_s: float, busy: float):
    """Let pictures be drawn; their time shrinks with the square of the scale. Yields the scales."""
    now_s = watch.now_s
    scales = []
    for _ in range(int(seconds * rate)):
        now_s += 1.0 / rate
        watch.all_s += busy / rate
        governor.add_picture(now_s, cost_s * governor.scale**2, watch.all_s)
        scales.append(governor.scale)
    watch.now_s = now_s
    return scales


watch.now_s, watch.all_s = 0.0, 0.0


def test_pictures_that_come_slowly_shrink_and_grow_again_once_there_is_time():
    governor = SizeGovernor()
    assert set(watch(governor, 3.0, 12.0, 0.05, 0.9)) == {1.0}  # our page acts first
    assert watch(governor, 3.0, 12.0, 0.05, 0.9)[-1] == SCALES[1]
    # fluent, but others keep the thread busy: it would not fit
    assert set(watch(governor, 30.0, 30.0, 0.01, 0.69)) == {SCALES[1]}
    assert watch(governor, 8.0, 30.0, 0.01, 0.3)[-1] == 1.0


def test_a_climb_that_fails_makes_the_next_one_wait_longer():
    governor = SizeGovernor()
    waits = []
    for _ in range(3):
        while governor.scale == 1.0:
            watch(governor, 1.0, 10.0, 0.01, 0.3)
        began = watch.now_s
        while governor.scale < 1.0:
            watch(governor, 1.0, 30.0, 0.01, 0.3)
        waits.append(watch.now_s - began)
    assert waits[1] > 1.5 * waits[0]
    assert waits[2] > 1.5 * waits[1]


def test_a_rate_between_the_bounds_changes_nothing():
    governor = SizeGovernor()
    assert set(watch(governor, 60.0, 24.0, 0.03, 0.9)) == {1.0}


def test_a_rest_is_no_slowness():
    governor = SizeGovernor()
    watch(governor, 3.5, 12.0, 0.05, 0.9)
    governor.pause()
    watch.now_s += 60.0
    assert set(watch(governor, 3.0, 12.0, 0.05, 0.9)) == {1.0}


def test_what_is_sent_again_stays_a_quarter_of_the_bitrate():
    budget, now_s, bitrate = ResendBudget(), 50.0, 960_000  # of packets of 9600 bit: 25 a second
    sent = 0
    for _ in range(400):  # ten seconds in which everything is asked for, over and over
        sent += budget.take(now_s, 17, bitrate)
        now_s += 0.025
    assert 250 <= sent <= 275
    assert budget.take(now_s + 60.0, 3, bitrate) == 3
    assert budget.take(now_s + 120.0, 1000, bitrate) == 25  # rest is not saved up


def densities(busy_at, seconds: float, scale: float = 1.0, first: float = FULL_DENSITY):
    """What a governor makes of pictures that take so many ticks to draw at each density."""
    detail = ViewDetail()
    detail.density = first
    governor, now_s, all_s, found = DetailGovernor(detail), 0.0, 0.0, []
    while now_s < seconds:
        took_s = busy_at(detail.density) * TICK_S
        now_s, all_s = now_s + max(TICK_S, took_s), all_s + took_s
        detail.drawn([], [])
        governor.add_picture(now_s, all_s, scale)
        found.append(detail.density)
    return found


def test_detail_falls_until_the_drawing_thread_keeps_up_and_stays_there():
    found = densities(lambda density: 0.4 + 4.0 * density, 10.0)
    assert 0.4 + 4.0 * found[-1] < 0.85
    assert len(set(found[-150:])) == 1
    assert densities(lambda _: 1.0, 20.0)[-1] == LEAST_DENSITY


def test_detail_falls_before_pictures_would_be_made_smaller():
    """Pictures that take twice their time are drawn in time two seconds later."""
    assert 0.2 + 8.0 * densities(lambda density: 0.2 + 8.0 * density, 2.5)[-1] < 1.0


def test_detail_rises_where_there_is_time_unless_pictures_are_small_for_want_of_it():
    assert densities(lambda _: 0.3, 20.0, first=0.05)[-1] == FULL_DENSITY
    assert densities(lambda _: 0.3, 20.0, scale=0.75, first=0.05)[-1] == 0.05
