"""Hair that frames show from the front alone stands off the back of the head too."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.splats.layout import COLOUR, OPACITY, POSITION
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.training.hair import Hair, hair_of_unseen_sides
from renderer.splats.training.surface_kinds import KINDS
from renderer.splats.training.views import View
from scene.arrays import Bool, Float
from scene.camera import orbit_camera
from scene.motion import Motion, Pose
from scene.skeleton import HEAD, JOINT_COUNT, JOINT_NAMES
from tests.renderer.splats.training.heads import bald_head

PLACE = slice(POSITION, POSITION + 3)
SKIN, DARK = (0.8, 0.6, 0.5), (0.15, 0.1, 0.08)
SCALP, NECK, FACE = (KINDS.index(kind) for kind in ("scalp", "neck", "face"))
POSES = np.tile(np.eye(4, dtype=np.float32), (JOINT_COUNT, 1, 1))


def curtain() -> Bool[np.ndarray, "N"]:
    """The head and neck behind the face, ears and all, down to where a bob ends."""
    body, first, kinds = bald_head()
    x, y, z = (first.parameters[:, PLACE] - body.skeleton.rest_joints[HEAD]).T
    behind = (z < 0.03) & ((kinds == NECK) | ((kinds == FACE) & (np.abs(x) > 0.04)))
    return (kinds == SCALP) | (behind & (y > -0.06))


def found(hair_m: float, worn: Bool[np.ndarray, "N"], colour: tuple[float, ...] = DARK) -> Hair:
    """What is told of the sides that face away from three frames from the front, of somebody on
    whom hair lies `hair_m` above the splats `worn`."""
    body, first, kinds = bald_head()
    parameters = first.parameters.copy()
    parameters[:, COLOUR : COLOUR + 3], parameters[:, OPACITY] = SKIN, 4.0
    parameters[worn, PLACE] += np.float32(hair_m) * first.normals[worn]
    parameters[worn, COLOUR : COLOUR + 3] = colour
    motion = Motion.from_poses([Pose(np.zeros((JOINT_COUNT, 3)), np.zeros(3), 0.0)])
    drawn = SplatModel(
        parameters,
        first.joints.astype(np.uint8),
        first.weights,
        np.ones(len(parameters), bool),
        body.skeleton,
        motion,
        "of a test",
    )
    middle, frames = body.skeleton.rest_joints[HEAD], []
    for azimuth in (-0.3, 0.0, 0.3):
        camera = orbit_camera(middle, 1.2, azimuth, 0.0, 240, 240, 0.5)
        rgba = SplatRenderer((drawn,)).render(camera, [POSES])
        frames.append((View.of((255.0 * rgba + 0.5).astype(np.uint8), camera), POSES))
    unseen = first.normals[:, 2] < 0.2
    return hair_of_unseen_sides(frames, first.parameters, first, kinds, unseen, body.skeleton)


def stands_off(hair: Hair, where: Bool[np.ndarray, "N"]) -> Float[np.ndarray, "M"]:
    return np.linalg.norm(hair.moves[where], axis=1)


def back_of(kind: int, above_m: float = -1.0) -> Bool[np.ndarray, "N"]:
    body, first, kinds = bald_head()
    above = first.parameters[:, PLACE] - body.skeleton.rest_joints[HEAD]
    return (kinds == kind) & (first.normals[:, 2] < -0.7) & (above[:, 1] > above_m)


@pytest.mark.parametrize("hair_m", [0.015, 0.03])
def test_the_back_of_a_head_has_the_hair_that_outlines_show(hair_m):
    _, _, kinds = bald_head()
    hair = found(hair_m, kinds == SCALP)
    off = stands_off(hair, back_of(SCALP, 0.03))
    assert np.median(off) == pytest.approx(hair_m, abs=0.005)
    assert np.percentile(np.abs(off - hair_m), 90) < 0.01


def test_a_bald_head_stays_as_it_is():
    hair = found(0.0, np.zeros(len(bald_head()[2]), bool))
    assert np.percentile(stands_off(hair, back_of(SCALP)), 95) < 0.005
    assert not hair.covered[back_of(NECK)].any()


def test_a_bob_hangs_over_the_neck_and_short_hair_does_not():
    nape, (_, _, kinds) = back_of(NECK, -0.05), bald_head()
    assert found(0.03, curtain()).covered[nape].mean() > 0.8
    assert found(0.015, kinds == SCALP).covered[nape].mean() < 0.2


def test_what_has_the_colour_of_skin_beside_a_neck_is_no_hair():
    hair = found(0.03, curtain(), SKIN)
    assert not hair.covered[back_of(NECK, -0.05)].any()


def test_hair_hangs_no_farther_out_than_it_stands_on_the_skull():
    body, first, kinds = bald_head()
    hair = found(0.03, curtain())
    across = (first.parameters[:, PLACE] - body.skeleton.rest_joints[HEAD]) * (1.0, 0.0, 1.0)
    moved = np.linalg.norm(across + hair.moves * (1.0, 0.0, 1.0), axis=1)
    skull, neck = (hair.covered & (kinds == kind) for kind in (SCALP, NECK))
    assert moved[neck].max() < moved[skull].max() + 0.002


def test_long_hair_hangs_from_the_skull_and_short_hair_follows_it():
    body, first, kinds = bald_head()
    beside = np.abs(first.parameters[:, POSITION] - body.skeleton.rest_joints[HEAD][0]) > 0.045
    locks = beside & np.isin(kinds, (FACE, NECK))
    long, short = found(0.03, curtain() | locks), found(0.03, kinds == SCALP)
    assert long.long
    assert not short.long
    nape = back_of(SCALP) & ~back_of(SCALP, 0.0) & long.covered & short.covered
    assert np.abs(long.moves[nape, 1]).max() < 1e-6, "straight down from farther up"
    assert np.abs(short.moves[nape, 1]).max() > 0.005


def test_faces_and_what_frames_show_stay():
    _, first, kinds = bald_head()
    hair = found(0.03, curtain())
    assert not hair.covered[first.normals[:, 2] >= 0.2].any()
    joints = [JOINT_NAMES.index(name) for name in ("head", "neck")]
    on_head = np.isin(first.joints[np.arange(len(kinds)), first.weights.argmax(axis=1)], joints)
    assert not hair.covered[~on_head].any()
    assert not hair.moves[~hair.covered].any()


def test_splats_of_a_larger_surface_are_larger():
    _, _, kinds = bald_head()
    hair = found(0.03, kinds == SCALP)
    back = hair.covered & back_of(SCALP, 0.03)
    assert 1.1 < np.exp(np.median(hair.growth[back])) < 1.5
    assert not hair.growth[~hair.covered].any()


def test_each_of_the_splats_that_take_ones_place_is_covered_as_it_was():
    hair = found(0.03, curtain())
    rows = np.repeat(np.flatnonzero(hair.covered)[:3], 2)
    taken = hair.taken(rows)
    assert taken.covered.all()
    np.testing.assert_array_equal(taken.moves, hair.moves[rows])


def test_nothing_is_told_where_no_side_is_unseen_or_no_frame_shows_a_head():
    body, first, kinds = bald_head()
    none = np.zeros(len(kinds), bool)
    seen = hair_of_unseen_sides([], first.parameters, first, kinds, none, body.skeleton)
    assert not seen.covered.any()
    blind = orbit_camera(np.array([0.0, 40.0, 0.0]), 1.2, 0.0, 0.0, 32, 32, 0.5)
    frame = View.of(np.zeros((32, 32, 4), np.uint8), blind)
    hidden = hair_of_unseen_sides(
        [(frame, POSES)], first.parameters, first, kinds, ~none, body.skeleton
    )
    assert not hidden.covered.any()
