"""Channels lose and delay what they are said to; a motion comes through a good one."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stability.axis import Axis
from benchmarks.stability.channel import LATENCY_S, MISSING, Channel
from benchmarks.stability.live import LIVE_AXES, drive, gestures, landmarks_of
from capture.body.landmark_names import LANDMARK_NAMES
from scene.motion import Pose
from tests.capture.people import body

RNG = np.random.default_rng
SECONDS = 60.0


def test_a_good_channel_brings_everything_in_order():
    found = Channel().deliveries(SECONDS, RNG(0))
    assert len(found) == 1800
    assert all(arrives == pytest.approx(sent + LATENCY_S) for sent, arrives in found)


def test_packets_are_lost_by_chance_in_bursts_and_once():
    assert len(Channel(loss=0.3).deliveries(SECONDS, RNG(0))) == pytest.approx(1260, rel=0.05)
    bursts = [sent % 2.0 for sent, _ in Channel(outage_s=0.4).deliveries(SECONDS, RNG(0))]
    assert min(bursts) >= 0.4 - 1e-9
    silent = [sent for sent, _ in Channel(silence_s=1.0).deliveries(SECONDS, RNG(0))]
    assert np.diff(silent).max() == pytest.approx(1.0 + 1.0 / 30.0)


def test_jitter_lets_packets_overtake():
    found = Channel(jitter_s=0.2).deliveries(SECONDS, RNG(0))
    assert [arrives for _, arrives in found] == sorted(arrives for _, arrives in found)
    assert [sent for sent, _ in found] != sorted(sent for sent, _ in found)
    late = np.array([arrives - sent for sent, arrives in found])
    assert LATENCY_S <= late.min() < late.max() <= LATENCY_S + 0.2


@pytest.mark.parametrize(("missing", "gone"), list(zip(MISSING, (0, 11, 5, 8), strict=True)))
def test_parts_are_not_seen(missing: str, gone: int):
    pixels, world = landmarks_of(body(), Pose.rest())
    _, _, visibility = Channel(missing=missing).seen(pixels, world, RNG(0))
    assert (visibility == 0.0).sum() == gone


def test_left_and_right_are_exchanged():
    pixels, world = landmarks_of(body(), Pose.rest())
    swapped, _, _ = Channel(exchanged=1.0).seen(pixels, world, RNG(0))
    left, right = (LANDMARK_NAMES.index(f"{side}_wrist") for side in ("left", "right"))
    np.testing.assert_array_equal(swapped[left], pixels[right])
    assert pixels[left, 0] > pixels[right, 0] + 50.0  # facing the camera


def test_a_motion_comes_through_a_good_channel():
    poses, told = drive(Channel(), gestures(), body(), RNG(0))
    assert told["refused"] == told["late"] == 0
    assert told["solved"] > 200
    truth = gestures()
    off = [
        np.abs(pose.joint_angles[1:] - truth.pose_at(time_s).joint_angles[1:]).mean()
        for time_s, pose in poses
    ]
    assert np.mean(off) < 0.12


@pytest.mark.parametrize("axis", LIVE_AXES, ids=lambda axis: axis.name)
def test_the_worst_channel_still_shows_somebody(axis: Axis):
    channel = next(one for one in LIVE_AXES if one.name == axis.name).channel(axis.steps[-1])
    poses, _ = drive(channel, gestures(), body(), axis.rng())
    assert len(poses) > 80
    assert all(np.isfinite(pose.joint_angles).all() for _, pose in poses)
