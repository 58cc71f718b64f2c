"""The prior of everyday poses."""

from __future__ import annotations

import torch

from capture.body.pose_prior import pose_prior
from tests.capture.people import JOINT


def test_joints_bend_one_way():
    prior, rest = pose_prior(), torch.zeros(1, 24, 3)
    hidden = torch.zeros(1, 24)
    bent, broken = rest.clone(), rest.clone()
    bent[0, JOINT["left_knee"], 0] = 0.5
    broken[0, JOINT["left_knee"], 0] = -0.5
    energy = [float(prior.energy(a, hidden)[0]) for a in (bent, broken)]
    assert energy[1] > energy[0] + 50.0
