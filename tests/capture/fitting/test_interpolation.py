"""Poses between those that were found."""

from __future__ import annotations

import numpy as np
import pytest

from capture.fitting.interpolation import interpolate_poses


def test_interpolation_follows_the_shortest_rotation():
    angles = np.zeros((2, 24, 3))
    angles[:, 0, 1] = [3.0, -3.0]
    found, times = np.array([0, 4]), np.arange(5.0)
    out, pelvis = interpolate_poses(found, angles, np.array([[0.0, 0, 0], [4.0, 0, 0]]), times)
    assert pelvis[:, 0] == pytest.approx(times)
    assert np.abs(out[2, 0, 1]) == pytest.approx(np.pi, abs=1e-6)
