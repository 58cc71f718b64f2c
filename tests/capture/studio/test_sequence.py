"""The studio: one person, seen whole, true to the pixel, and the same for the same seed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.body.model import load_body_model
from capture.errors import CaptureError
from capture.sources.bvh import read_bvh
from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.motions import gesture_motion, turntable_motion, with_turn
from capture.studio.named_performers import NAMED_PERFORMERS
from capture.studio.performer import make_performer, render_performer
from scene import Camera, Motion, Pose, PoseTrust, Sequence, orbit_camera
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE
from tests.capture.bvh_files import bvh_text, person
from tests.shared_data import shared_data

FRAMES, SIZE, CAMERAS = 8, 96, 5


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("studio") / "plain"
    make_sequence(out, frames=FRAMES, size=SIZE, test_cameras=CAMERAS, seed=3)
    return out


@pytest.fixture(scope="module")
def sequence(plain) -> Sequence:
    return open_sequence(plain)


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.suffix == ".png"
    }


def rows_filled(mask: np.ndarray) -> float:
    rows = np.flatnonzero(mask.max(axis=1) > 0.0)
    return (rows[-1] + 1 - rows[0]) / len(mask)


def facing(motion: Motion) -> np.ndarray:
    """Yaw of the pelvis, degrees, unwrapped."""
    skeleton = load_body_model().body(np.zeros(5)).skeleton
    joints = skeleton.joint_transforms(motion.joint_angles, motion.root_translation)
    return np.rad2deg(np.unwrap(np.arctan2(joints[:, 0, 0, 2], joints[:, 0, 2, 2])))


def test_splits_and_cameras(sequence):
    assert len(sequence.train) == FRAMES
    assert sequence.pose_trust is PoseTrust.EXACT
    assert set(sequence.test) == {NOVEL_VIEW, UNSEEN_POSE}
    assert len(sequence.test[NOVEL_VIEW]) == FRAMES  # no more than there are moments
    assert len(sequence.test[UNSEEN_POSE]) == 8
    train = {sequence.train.camera(i).world_to_camera.tobytes() for i in range(FRAMES)}
    ring = {
        source.camera(i).world_to_camera.tobytes()
        for source in sequence.test.values()
        for i in range(len(source))
    }
    assert len(train) == 1
    assert len(ring) == CAMERAS
    assert not train & ring


def test_test_poses_are_what_their_split_says(sequence):
    trained = {sequence.train.pose(i).joint_angles.tobytes() for i in range(FRAMES)}
    for name, known in ((NOVEL_VIEW, True), (UNSEEN_POSE, False)):
        source = sequence.test[name]
        for index in range(len(source)):
            assert (source.pose(index).joint_angles.tobytes() in trained) is known


def test_person_fills_the_picture_and_is_never_cut(sequence):
    for source in (sequence.train, *sequence.test.values()):
        for index in range(len(source)):
            mask = source.mask(index)
            edge = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
            assert edge.max() == 0.0
            if source is sequence.train:
                assert rows_filled(mask) >= 0.6


def test_joints_lie_inside_the_mask(sequence):
    skeleton = sequence.body.skeleton
    for source in (sequence.train, *sequence.test.values()):
        for index in range(len(source)):
            pose, mask = source.pose(index), source.mask(index)
            joints = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)
            pixels, depth = source.camera(index).project(joints[:, :3, 3])
            assert depth.min() > 0.0
            column, row = np.floor(pixels).astype(int).T
            assert mask[row, column].min() > 0.0


def test_pixels_are_premultiplied_over_black(sequence):
    image, mask = sequence.train.image(0), sequence.train.mask(0)
    assert image[mask == 0.0].max() == 0.0
    assert (image <= mask[..., None] + 1.0 / 255.0).all()


def test_edges_are_anti_aliased(sequence):
    alpha = np.unique(np.round(sequence.train.mask(0) * 16.0))
    assert len(alpha) > 12  # of the 17 levels that 4 x 4 samples have
    soft = (sequence.train.mask(0) > 0.0) & (sequence.train.mask(0) < 1.0)
    assert 0.02 < soft.sum() / (sequence.train.mask(0) > 0.0).sum() < 0.5


def test_same_seed_gives_the_same_bytes_and_another_another(plain, tmp_path):
    for name, seed in (("same", 3), ("other", 4)):
        make_sequence(tmp_path / name, frames=FRAMES, size=SIZE, test_cameras=CAMERAS, seed=seed)
    assert files_of(tmp_path / "same") == files_of(plain)
    assert open_sequence(tmp_path / "same").data_hash == open_sequence(plain).data_hash
    assert files_of(tmp_path / "other") != files_of(plain)


def test_lit_changes_colours_within_bounds_and_nothing_else(plain, sequence, tmp_path):
    make_sequence(
        tmp_path / "lit", look="lit", frames=FRAMES, size=SIZE, test_cameras=CAMERAS, seed=3
    )
    lit = open_sequence(tmp_path / "lit")
    ratios = []
    for index in range(FRAMES):
        mask = sequence.train.mask(index)
        np.testing.assert_array_equal(lit.train.mask(index), mask)
        flat, shaded = sequence.train.image(index), lit.train.image(index)
        bright = (mask == 1.0) & (flat.min(axis=-1) > 0.2)
        ratios.append((shaded[bright] / flat[bright]).ravel())
    ratio = np.concatenate(ratios)
    assert ratio.min() > 0.70
    assert ratio.max() < 1.02
    assert np.percentile(ratio, 95) - np.percentile(ratio, 5) > 0.08


def hold(yaw_rad: float) -> Pose:
    angles = np.zeros((24, 3))
    angles[0, 1] = yaw_rad
    return Pose(angles, np.zeros(3))


def round_the_person(azimuth_rad: float) -> Camera:
    return orbit_camera(np.array([0.0, 0.9, 0.0]), 3.5, azimuth_rad, 0.0, SIZE, SIZE, 0.6)


@pytest.mark.parametrize(("look", "same"), [("plain", True), ("lit", False)])
def test_light_stays_with_the_room(look, same):
    """Turning the person or walking round them shows the same pixels only in flat light."""
    performer = make_performer(1)
    turn = np.pi / 2
    turned_person, _ = render_performer(performer, hold(-turn), round_the_person(0.0), look)
    walked_round, _ = render_performer(performer, hold(0.0), round_the_person(turn), look)
    assert np.allclose(turned_person, walked_round, atol=1e-2) is same


def test_colours_are_finer_than_the_mesh():
    """The texture is evaluated at every sample: stripes and letters, not vertex colours."""
    image, mask = render_performer(make_performer(0), hold(0.0), round_the_person(0.0), "plain")
    inside = (mask[:, 1:] == 1.0) & (mask[:, :-1] == 1.0)
    steps = np.abs(np.diff(image, axis=1)).max(axis=-1)[inside]
    assert (steps > 0.15).mean() > 0.05


def test_default_turn_shows_every_side(sequence):
    yaw = facing(sequence.motion)
    step = 360.0 / FRAMES
    assert yaw[-1] - yaw[0] == pytest.approx(360.0 - step, abs=1.0)
    assert np.diff(yaw).max() < 1.2 * step
    assert facing(turntable_motion(10, 10.0, 0.0)).max() < 1.0


def test_gestures_are_unlike_the_training_motion():
    seen, unseen = (
        move(32, 10.0, *more).joint_angles[:, 1:]
        for move, more in ((turntable_motion, (360.0,)), (gesture_motion, ()))
    )
    nearest = np.array([np.abs(seen - pose).max(axis=(1, 2)).min() for pose in unseen])
    assert np.rad2deg(nearest.min()) > 20.0


def test_turning_a_motion_carries_its_path_along():
    still = turntable_motion(4, 10.0, 0.0)
    walk = replace(still, root_translation=np.tile([1.0, 0.0, 0.0], (4, 1)))
    around = with_turn(walk, 360.0)
    np.testing.assert_allclose(
        around.root_translation, [[1, 0, 0], [0, 0, -1], [-1, 0, 0], [0, 0, 1]], atol=1e-12
    )


def test_motion_from_a_file(tmp_path):
    frames = [{"LeftArm": (-40.0 + index, 0.0, 0.0)} for index in range(40)]
    (tmp_path / "clip.bvh").write_text(bvh_text(person(), frames, frame_time_s=0.1))
    make_sequence(
        tmp_path / "seq",
        motion=tmp_path / "clip.bvh",
        frames=36,
        size=48,
        test_cameras=2,
        turn_deg=0.0,
        frames_per_second=10.0,
    )
    sequence = open_sequence(tmp_path / "seq")
    shoulder = [np.rad2deg(sequence.train.pose(i).joint_angles[16, 2]) for i in range(36)]
    # as fast as recorded, and back when its span is over
    wanted = -40.0 + 29.25 - np.abs(29.25 - np.arange(36.0))
    np.testing.assert_allclose(shoulder, wanted, atol=1e-3)
    # the first three quarters train, the rest is unseen
    unseen = sequence.test[UNSEEN_POSE]
    assert min(np.rad2deg(unseen.pose(i).joint_angles[16, 2]) for i in range(8)) > -10.8


@pytest.mark.parametrize("name", NAMED_PERFORMERS)
def test_the_cast_moves_to_its_clips(tmp_path, name):
    make_sequence(
        tmp_path / "seq",
        performer=name,
        motion=shared_data("mocap"),
        frames=6,
        size=64,
        test_cameras=2,
        seed=99,
    )
    sequence = open_sequence(tmp_path / "seq")
    assert sequence.person == name
    body = make_performer(NAMED_PERFORMERS[name].seed).body
    np.testing.assert_allclose(sequence.body.skeleton.rest_joints, body.skeleton.rest_joints)
    clip = read_bvh(shared_data(f"mocap/{NAMED_PERFORMERS[name].clip}.bvh"), body.skeleton)
    bend = sequence.train.pose(0).joint_angles[1:]
    np.testing.assert_allclose(bend, clip.joint_angles[0, 1:], atol=1e-12)
    assert min(rows_filled(sequence.train.mask(index)) for index in range(6)) > 0.3


def test_the_cast_are_different_people():
    people = [make_performer(role.seed) for role in NAMED_PERFORMERS.values()]
    assert len({person.outfit.skin.tobytes() for person in people}) == len(NAMED_PERFORMERS) == 5
    assert np.ptp([person.body.skeleton.height_m for person in people]) > 0.1
    assert {person.outfit.long_sleeves for person in people} == {True, False}
    assert {person.outfit.checked for person in people} == {True, False}


@pytest.mark.parametrize("clip", ["walk_figure8_91_62", "bend_scoop_lift_arm_02_06"])
def test_real_motion_is_framed_whole_and_large(tmp_path, clip):
    """However far somebody walks, and however low they reach."""
    make_sequence(
        tmp_path / "seq",
        motion=shared_data(f"mocap/{clip}.bvh"),
        frames=24,
        size=64,
        test_cameras=4,
    )
    sequence = open_sequence(tmp_path / "seq")
    masks = [sequence.train.mask(index) for index in range(24)]
    for mask in masks:
        assert np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]]).max() == 0.0
    assert max(rows_filled(mask) for mask in masks) > 0.7


def test_progress_is_told(tmp_path):
    told: list[tuple[float, str]] = []
    make_sequence(
        tmp_path / "seq",
        frames=2,
        size=32,
        test_cameras=1,
        on_progress=lambda fraction, message: told.append((fraction, message)),
    )
    assert [fraction for fraction, _ in told] == sorted(fraction for fraction, _ in told)
    assert told[-1] == (1.0, "frame 12 of 12")  # 2 of training, 2 new views, 8 unseen poses


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"look": "disco"}, "look must be one of plain, lit, loose; got 'disco'"),
        ({"performer": "zeus"}, "performer must be one of amber, basil, .*; got 'zeus'"),
        ({"motion": Path(__file__).parent}, "must be a .bvh file unless a performer .* is named"),
        (
            {"motion": Path(__file__).parent, "performer": "dune"},
            r"motion must hold wash_self_02_10\.bvh, dune's clip; got",
        ),
        ({"frames": 0}, "frames must be at least 1; got 0"),
        ({"frames": -3}, "frames must be at least 1; got -3"),
        ({"size": 0}, "size must be at least 16; got 0"),
        ({"test_cameras": 0}, "test_cameras must be at least 1; got 0"),
        ({"turn_deg": float("nan")}, "turn_deg must be finite; got nan"),
    ],
)
def test_senseless_requests_are_refused_before_anything_is_written(tmp_path, changed, message):
    with pytest.raises(CaptureError, match=message):
        make_sequence(tmp_path / "seq", **{"frames": 2, "size": 32, "test_cameras": 1, **changed})
    assert list(tmp_path.iterdir()) == []


def test_uniform_clothes_have_one_colour_each():
    """Of the same person: fewer edges inside the outline, and the same outline."""
    striped, uniform = (
        render_performer(make_performer(0, uniform=one), hold(0.0), round_the_person(0.0), "plain")
        for one in (False, True)
    )
    np.testing.assert_array_equal(striped[1], uniform[1])
    inside = (striped[1][:, 1:] == 1.0) & (striped[1][:, :-1] == 1.0)
    edges = [
        float((np.abs(np.diff(image, axis=1)).max(axis=-1)[inside] > 0.15).mean())
        for image, _ in (striped, uniform)
    ]
    assert edges[1] < 0.4 * edges[0]
