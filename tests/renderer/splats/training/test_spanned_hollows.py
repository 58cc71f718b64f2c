"""Cloth spans the hollow of a back that nobody filmed, away from the camera alone."""

from __future__ import annotations

import numpy as np

from renderer.splats.training.spanned_hollows import spanned
from renderer.splats.training.surface_kinds import KINDS

TRUNK, ARMS = KINDS.index("trunk"), KINDS.index("arms")


def trunk(turn_rad: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places, normals, and whether they face the front, of a round trunk, 0.15 m wide, whose back
    is 4 cm hollow in the middle of its height."""
    height, angle = np.meshgrid(np.linspace(0.0, 0.5, 60), np.linspace(0.0, 2 * np.pi, 120, False))
    height, angle = height.ravel(), angle.ravel()
    back = np.maximum(-np.cos(angle), 0.0)
    radius = 0.15 - 0.04 * back * np.sin(np.pi * height / 0.5)
    out = np.stack([np.sin(angle + turn_rad), 0.0 * angle, np.cos(angle + turn_rad)], axis=1)
    places = radius[:, None] * out
    places[:, 1] = height
    return places, out, np.cos(angle) > 0.0


def moved(turn_rad: float = 0.0, kind: int = TRUNK) -> tuple[np.ndarray, ...]:
    places, normals, front = trunk(turn_rad)
    return places, spanned(places, normals, np.full(len(places), kind), front), normals, front


def test_a_hollow_back_is_spanned_by_half():
    places, moves, normals, _ = moved()
    middle = (np.abs(places[:, 1] - 0.25) < 0.02) & (normals[:, 2] < -0.95)
    np.testing.assert_allclose(moves[middle, 2], -0.02, atol=0.005)
    ends = (np.abs(places[:, 1] - 0.25) > 0.24) & (normals[:, 2] < -0.95)
    assert np.abs(moves[ends]).max() < 0.006


def test_what_frames_show_stays_and_so_does_the_outline():
    _, moves, normals, front = moved()
    assert not moves[front].any()
    assert np.abs(moves[:, :2]).max() < 1e-3
    flanks = ~front & (np.abs(normals[:, 0]) > 0.98)
    assert np.abs(moves[flanks]).max() < 0.006


def test_cloth_moves_away_from_wherever_the_camera_was():
    _, ahead, _, _ = moved()
    _, beside, _, _ = moved(np.pi / 2)
    np.testing.assert_allclose(beside[:, 0], ahead[:, 2], atol=1e-3)
    np.testing.assert_allclose(beside[:, [1, 2]], 0.0, atol=1e-3)


def test_nothing_steps_from_one_splat_to_the_next():
    _, moves, _, _ = moved()
    grid = moves[:, 2].reshape(120, 60)
    assert np.abs(np.diff(grid, axis=0)).max() < 0.003
    assert np.abs(np.diff(grid, axis=1)).max() < 0.003


def test_only_the_trunk_of_somebody_seen_from_one_side_hangs():
    places, normals, front = trunk()
    assert not moved(kind=ARMS)[1].any()
    every = np.full(len(places), TRUNK)
    assert not spanned(places, normals, every, np.ones_like(front)).any()
    assert not spanned(places, normals, every, np.zeros_like(front)).any()
    assert not spanned(places[:0], normals[:0], every[:0], front[:0]).any()
