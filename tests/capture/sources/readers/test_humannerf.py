"""HumanNeRF's layout: what we write their code reads, what they write we read."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from capture.errors import BrokenDataset, BrokenSequence
from capture.sources.readers import open_folder, open_humannerf, write_humannerf
from capture.sources.readers.humannerf import PICKLES
from capture.storage import open_sequence
from capture.studio import make_sequence
from scene import PoseTrust, Sequence
from scene.rotations import axis_angle_to_matrix
from tests.capture.sources.readers.layouts import (
    BACKGROUND,
    Y_DOWN,
    Truth,
    seen_joints,
    write_humannerf_of_a_video,
)

FRAMES = 6


@pytest.fixture(scope="module")
def studio(tmp_path_factory) -> Sequence:
    out = tmp_path_factory.mktemp("studio") / "seq"
    make_sequence(out, frames=FRAMES, size=96, test_cameras=1, seed=5)
    return open_sequence(out)


@pytest.fixture(scope="module")
def folder(studio, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("humannerf") / "performer"
    write_humannerf(studio, out)
    return out


@pytest.fixture(scope="module")
def video(tmp_path_factory) -> tuple[Truth, Path]:
    truth = Truth(world=Y_DOWN)
    return truth, write_humannerf_of_a_video(tmp_path_factory.mktemp("video") / "wild", truth)


def test_round_trip_keeps_camera_pose_and_pixels(studio, folder):
    again = open_humannerf(folder)
    assert (len(again.train), again.person) == (FRAMES, "performer")
    np.testing.assert_allclose(
        again.body.skeleton.rest_joints, studio.body.skeleton.rest_joints, atol=1e-6
    )
    for index in range(FRAMES):
        ours, theirs = studio.frame(index), again.frame(index)
        np.testing.assert_allclose(theirs.camera.intrinsics, ours.camera.intrinsics, atol=1e-4)
        np.testing.assert_allclose(
            theirs.camera.world_to_camera, ours.camera.world_to_camera, atol=1e-12
        )
        np.testing.assert_allclose(
            axis_angle_to_matrix(theirs.pose.joint_angles),
            axis_angle_to_matrix(ours.pose.joint_angles),
            atol=1e-6,
        )
        np.testing.assert_allclose(
            theirs.pose.root_translation, ours.pose.root_translation, atol=1e-6
        )
        np.testing.assert_array_equal(theirs.mask, ours.mask)
        assert np.abs(theirs.image - ours.image).max() < 1.01 / 255.0


def test_what_is_written_is_what_their_code_expects(folder, studio):
    """Their own steps: joints of the T-pose, moved by Rh and Th, seen through K and E."""
    held = {p.stem: pickle.loads(p.read_bytes()) for p in folder.glob("*.pkl")}
    names = [f"frame_{index:06d}" for index in range(FRAMES)]
    assert sorted(held) == ["cameras", "canonical_joints", "mesh_infos"]
    assert list(held["cameras"]) == list(held["mesh_infos"]) == names
    assert held["canonical_joints"]["joints"].shape == (24, 3)
    for index, name in enumerate(names):
        camera, mesh = held["cameras"][name], held["mesh_infos"][name]
        shapes = {key: value.shape for key, value in {**camera, **mesh}.items()}
        assert shapes == {
            "intrinsics": (3, 3),
            "extrinsics": (4, 4),
            "distortions": (5,),
            "Rh": (3,),
            "Th": (3,),
            "poses": (72,),
            "joints": (24, 3),
            "tpose_joints": (24, 3),
        }
        assert not mesh["poses"][:3].any()  # the pelvis is turned by Rh alone
        world = mesh["joints"] @ cv2.Rodrigues(mesh["Rh"].astype(float))[0].T + mesh["Th"]
        seen = world @ camera["extrinsics"][:3, :3].T + camera["extrinsics"][:3, 3]
        pixels = (seen @ camera["intrinsics"].T)[:, :2] / seen[:, 2:]
        expected = seen_joints(studio.train, studio.body, index) - 0.5  # theirs count from centres
        np.testing.assert_allclose(pixels, expected, atol=1e-3)
        mask = cv2.imread(str(folder / "masks" / f"{name}.png"), cv2.IMREAD_UNCHANGED)
        picture = cv2.imread(str(folder / "images" / f"{name}.png"), cv2.IMREAD_UNCHANGED)
        assert mask is not None
        assert picture is not None
        assert mask.shape == picture.shape == (96, 96, 3)


def test_a_video_prepared_by_their_tool_is_read(video):
    truth, folder = video
    sequence = open_folder(folder)
    assert sequence.pose_trust is PoseTrust.GIVEN
    assert sequence.body.has_surface
    for index in (0, 7, 23):
        got = seen_joints(sequence.train, sequence.body, index)
        np.testing.assert_allclose(got, truth.joint_pixels(index, 0), atol=0.02)
        image, mask = sequence.train.image(index), sequence.train.mask(index)
        pixels, alpha = truth.picture(index, 0)
        np.testing.assert_allclose(mask, alpha / 255.0, atol=1e-6)
        assert image[mask == 0.0].max() == 0.0  # the wall is gone
        assert abs(float((pixels / 255.0)[mask == 0.0].mean()) - BACKGROUND) < 0.01
        np.testing.assert_allclose(image[mask == 1.0], pixels[..., ::-1][mask == 1.0] / 255.0)


def test_their_world_is_set_upright_on_its_floor(video):
    _, folder = video
    sequence = open_humannerf(folder)
    joints = sequence.body.skeleton.joint_transforms(
        sequence.motion.joint_angles, sequence.motion.root_translation
    )[..., :3, 3]
    assert (joints[:, 15, 1] - joints[:, 0, 1]).mean() > 0.4  # heads are above hips
    lowest = joints[:, (7, 8, 10, 11), 1].min(axis=1)
    assert 0.0 < np.median(lowest) < 0.1
    rest = sequence.body.skeleton.rest_joints
    np.testing.assert_allclose(rest[0, [0, 2]], 0.0, atol=1e-12)
    assert 0.0 < rest[:, 1].min() < 0.1


def test_the_lens_is_undone(video, tmp_path):
    _, folder = video
    bent = np.array([-0.2, 0.05, 0.001, -0.002, 0.01])
    held = pickle.loads((folder / "cameras.pkl").read_bytes())
    for camera in held.values():
        camera["distortions"] = bent.astype(np.float32)
    copy = tmp_path / "bent"
    copy.mkdir()
    for name in ("images", "masks", "mesh_infos.pkl", "canonical_joints.pkl"):
        (copy / name).symlink_to(folder / name)
    (copy / "cameras.pkl").write_bytes(pickle.dumps(held))
    frames = open_humannerf(copy).train
    raw = cv2.imread(str(folder / "images" / "000000.png"))
    assert raw is not None
    straight = cv2.undistort(raw, held["000000"]["intrinsics"].astype(float), bent)
    solid = frames.mask(0) == 1.0
    np.testing.assert_allclose(
        frames.image(0)[solid], straight[..., ::-1][solid] / 255.0, atol=1.01 / 255.0
    )
    assert frames.camera(0).distortion is None


def _as_others_write(value: Any) -> Any:
    """Double precision, column vectors, and nothing that need not be there."""
    if isinstance(value, dict):
        unneeded = ("joints", "distortions") if "Rh" in value or "intrinsics" in value else ()
        return {k: _as_others_write(v) for k, v in value.items() if k not in unneeded}
    wide = np.asarray(value, np.float64)
    return wide[:, None] if wide.shape == (3,) else wide


@pytest.mark.parametrize("protocol", [2, 5])
@pytest.mark.parametrize("person", [1, 255])
def test_what_others_write_otherwise_is_read_the_same(folder, tmp_path, protocol, person):
    """Pickles of any protocol, JPEG, masks of one channel that hold 0 and 1 or 0 and 255."""
    expected = open_humannerf(folder)
    for name in PICKLES:
        held = _as_others_write(pickle.loads((folder / name).read_bytes()))
        (tmp_path / name).write_bytes(pickle.dumps(held, protocol=protocol))
    for kind in ("images", "masks"):
        (tmp_path / kind).mkdir()
        for file in (folder / kind).iterdir():
            pixels = cv2.imread(str(file))
            assert pixels is not None
            if kind == "images":
                cv2.imwrite(str(tmp_path / kind / f"{file.stem}.jpg"), pixels)
            else:
                sharp = (pixels[..., 0] > 127).astype(np.uint8) * person
                cv2.imwrite(str(tmp_path / kind / file.name), sharp)
    got = open_folder(tmp_path)
    assert len(got.train) == len(expected.train)
    for index in (0, len(got.train) - 1):
        one, other = got.train.camera(index), expected.train.camera(index)
        assert np.allclose(one.world_to_camera, other.world_to_camera, atol=1e-6)
        assert np.allclose(one.intrinsics, other.intrinsics, atol=1e-4)
        angles = (source.train.pose(index).joint_angles for source in (got, expected))
        assert np.allclose(*angles, atol=1e-6)
        assert np.array_equal(got.train.mask(index), expected.train.mask(index) > 127.5 / 255.0)
        assert np.abs(got.train.image(index) - expected.train.image(index)).mean() < 0.02


def test_data_hash_follows_what_training_reads(folder, tmp_path, studio):
    write_humannerf(studio, tmp_path / "performer")
    first, again = open_humannerf(folder), open_humannerf(tmp_path / "performer")
    assert first.data_hash == again.data_hash
    mask = tmp_path / "performer" / "masks" / "frame_000001.png"
    cv2.imwrite(str(mask), np.zeros((96, 96, 3), np.uint8))
    assert open_humannerf(tmp_path / "performer").data_hash != first.data_hash


class Evil:
    """Runs a command when unpickled by Python's own pickle."""

    def __init__(self, command: str) -> None:
        self.command = command

    def __reduce__(self):
        return os.system, (self.command,)


@pytest.mark.parametrize("name", ["cameras.pkl", "mesh_infos.pkl", "canonical_joints.pkl"])
def test_code_in_a_pickle_is_refused(video, tmp_path, name):
    _, folder = video
    copy = tmp_path / "evil"
    copy.mkdir()
    for held in folder.iterdir():
        (copy / held.name).symlink_to(held)
    (copy / name).unlink()
    (copy / name).write_bytes(pickle.dumps({"joints": Evil(f"touch {tmp_path / 'ran'}")}))
    with pytest.raises(BrokenDataset, match=rf"^{name} must hold only arrays, .*system"):
        open_folder(copy)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("cameras.pkl", lambda h: h.pop("000003"), r"cameras\.pkl must hold .*000003 is missing"),
        ("mesh_infos.pkl", lambda h: h["000000"].pop("Rh"), "000000 must hold .*Rh is missing"),
        (
            "mesh_infos.pkl",
            lambda h: h["000000"].update(poses=np.zeros(71)),
            "poses of 000000 must be 72; got 71",
        ),
        (
            "mesh_infos.pkl",
            lambda h: h["000000"].update(Th=np.full(3, np.nan)),
            "Th of 000000 must be finite",
        ),
        ("canonical_joints.pkl", lambda h: h.clear(), "joints is missing"),
    ],
)
def test_broken_folders_say_what_is_wrong(video, tmp_path, file, change, message):
    _, folder = video
    for name in folder.iterdir():
        (tmp_path / name.name).symlink_to(name)
    held = pickle.loads((folder / file).read_bytes())
    change(held)
    (tmp_path / file).unlink()
    (tmp_path / file).write_bytes(pickle.dumps(held))
    with pytest.raises(BrokenDataset, match=message):
        open_humannerf(tmp_path)


def test_missing_and_unequal_pictures_are_named(video, tmp_path):
    _, folder = video
    for name in folder.iterdir():
        (tmp_path / name.name).symlink_to(name)
    (tmp_path / "masks").unlink()
    (tmp_path / "masks").mkdir()
    frames = open_humannerf(tmp_path).train
    with pytest.raises(BrokenDataset, match=r"000000\.png must be a picture; got no file"):
        frames.mask(0)
    cv2.imwrite(str(tmp_path / "masks" / "000001.png"), np.zeros((5, 4, 3), np.uint8))
    with pytest.raises(BrokenDataset, match=r"first picture \(96 x 96\); got 4 x 5"):
        frames.mask(1)


def test_a_folder_of_no_known_layout_is_refused(tmp_path):
    with pytest.raises(
        BrokenSequence, match=r"must be a sequence folder: with sequence\.json .*HumanNeRF.*ZJU"
    ):
        open_folder(tmp_path)


def test_nothing_is_overwritten(folder, studio):
    with pytest.raises(BrokenDataset, match="out must not exist yet"):
        write_humannerf(studio, folder)
