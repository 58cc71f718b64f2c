"""ZJU-MoCap's own layouts, as first given and with the refined calibration."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.errors import BrokenDataset
from capture.sources.readers import open_folder, open_zju_mocap
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE
from tests.capture.sources.readers.layouts import SIZE, Truth, seen_joints, write_zju

VARIANTS = {
    "original": {},
    "refined": {"refined": True},
    "numbered from one": {"numbered_from_one": True},
}


@pytest.fixture(scope="module")
def truth() -> Truth:
    return Truth()


@pytest.fixture(scope="module")
def original(truth, tmp_path_factory) -> Path:
    return write_zju(tmp_path_factory.mktemp("zju") / "CoreView_387", truth)


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_camera_sees_the_joints_where_they_are(truth, tmp_path, variant):
    sequence = open_folder(write_zju(tmp_path / "CoreView_387", truth, **VARIANTS[variant]))
    assert sequence.person == "CoreView_387"
    assert (len(sequence.train), len(sequence.test[NOVEL_VIEW])) == (32, 2 * 2)
    assert len(sequence.test[UNSEEN_POSE]) == 2
    for index in (0, 13, 31):
        got = seen_joints(sequence.train, sequence.body, index)
        np.testing.assert_allclose(got, truth.joint_pixels(index, 0), atol=1e-3)
    novel = sequence.test[NOVEL_VIEW]
    for index, (moment, camera) in enumerate([(0, 1), (0, 2), (30, 1), (30, 2)]):
        got = seen_joints(novel, sequence.body, index)
        np.testing.assert_allclose(got, truth.joint_pixels(moment, camera), atol=1e-3)
        assert novel.pose(index).time_s == pytest.approx(moment / 30.0)
    unseen = sequence.test[UNSEEN_POSE]
    got = seen_joints(unseen, sequence.body, 1)
    np.testing.assert_allclose(got, truth.joint_pixels(32, 2), atol=1e-3)


@pytest.mark.parametrize("variant", VARIANTS)
def test_pictures_are_the_person_alone(truth, tmp_path, variant):
    sequence = open_zju_mocap(write_zju(tmp_path / "zju", truth, **VARIANTS[variant]))
    for index in (0, 20):
        _, alpha = truth.picture(index, 0)
        np.testing.assert_array_equal(sequence.train.mask(index), alpha > 127)
        image = sequence.train.image(index)
        assert image[alpha <= 127].max() == 0.0
        inside = cv2.erode((alpha > 127).astype(np.uint8), np.ones((5, 5))) > 0
        pixels, _ = truth.picture(index, 0)
        off = np.abs(image[inside] - pixels[..., ::-1][inside] / 255.0)
        assert off.mean() < 0.025  # JPEG


def test_the_world_is_set_upright(original):
    sequence = open_zju_mocap(original)
    joints = sequence.body.skeleton.joint_transforms(
        sequence.motion.joint_angles, sequence.motion.root_translation
    )[..., :3, 3]
    assert (joints[:, 15, 1] - joints[:, 0, 1]).mean() > 0.4
    assert np.abs(np.median(joints[:, (10, 11), 1].min(axis=1))) < 0.1


def test_another_camera_may_train(truth, original):
    sequence = open_zju_mocap(original, training_camera=2)
    got = seen_joints(sequence.train, sequence.body, 5)
    np.testing.assert_allclose(got, truth.joint_pixels(5, 2), atol=1e-3)
    assert sequence.data_hash != open_zju_mocap(original).data_hash
    with pytest.raises(BrokenDataset, match="must be one of the 3 cameras; got 3"):
        open_zju_mocap(original, training_camera=3)


def test_joints_are_found_from_moving_vertices(truth, tmp_path):
    path = write_zju(tmp_path / "zju", truth, joints=False)
    sequence = open_zju_mocap(path)
    rest = truth.performer.body.skeleton.rest_joints
    off = np.linalg.norm(sequence.body.skeleton.rest_joints - rest, axis=1)
    assert off.mean() < 0.02
    got = seen_joints(sequence.train, sequence.body, 3)
    assert np.linalg.norm(got - truth.joint_pixels(3, 0), axis=1).mean() < 0.02 * SIZE


def test_a_broken_camera_is_no_test_camera(truth, tmp_path):
    path = write_zju(tmp_path / "zju", truth)
    for picture in (path / "Camera_B2").iterdir():
        picture.unlink()
    sequence = open_zju_mocap(path)
    assert len(sequence.test[NOVEL_VIEW]) == 2


def test_the_lens_is_undone(truth, tmp_path):
    bent = (-0.2, 0.05, 0.001, -0.002, 0.01)
    frames = open_zju_mocap(write_zju(tmp_path / "zju", truth, distortion=bent)).train
    raw = cv2.imread(str(tmp_path / "zju" / "Camera_B1" / "000000.jpg"))
    assert raw is not None
    straight = cv2.undistort(raw, truth.their_intrinsics(0), np.array(bent))
    solid = frames.mask(0) == 1.0
    np.testing.assert_allclose(
        frames.image(0)[solid], straight[..., ::-1][solid] / 255.0, atol=1.01 / 255.0
    )


def save(path: Path, held: object) -> None:
    np.save(path, held)  # type: ignore[arg-type]


def annots_of(path: Path) -> dict:
    return np.load(path / "annots.npy", allow_pickle=True).item()


def no_t(path: Path) -> None:
    held = annots_of(path)
    del held["cams"]["T"]
    save(path / "annots.npy", held)


def short_d(path: Path) -> None:
    held = annots_of(path)
    held["cams"]["D"] = [np.zeros(4)] * 3
    save(path / "annots.npy", held)


def outside(path: Path) -> None:
    held = annots_of(path)
    held["ims"][0]["ims"][0] = "../../secret/000000.jpg"
    save(path / "annots.npy", held)


def no_moments(path: Path) -> None:
    save(path / "annots.npy", {**annots_of(path), "ims": []})


def code_in_annots(path: Path) -> None:
    save(path / "annots.npy", {"cams": Path("x"), "ims": []})


def code_in_parameters(path: Path) -> None:
    save(path / "new_params" / "3.npy", {"poses": Path("x")})


def no_parameters(path: Path) -> None:
    (path / "new_params").rename(path / "elsewhere")


def one_missing(path: Path) -> None:
    (path / "new_params" / "7.npy").unlink()


def no_joints(path: Path) -> None:
    (path / "lbs" / "joints.npy").unlink()
    (path / "new_vertices").rename(path / "elsewhere")


def no_mask(path: Path) -> None:
    for kind in ("mask", "mask_cihp"):
        (path / kind / "Camera_B1" / "000004.png").unlink()


@pytest.mark.parametrize(
    ("breaking", "message"),
    [
        (no_t, "cams of annots.npy must hold K, D, R, T; T is missing"),
        (short_d, "D of annots.npy must be 3 x 5; got 3 x 4"),
        (outside, r"pictures must lie in the data set's folder; got '\.\./"),
        (no_moments, "ims of annots.npy must be a list of moments; got none"),
        (code_in_annots, r"annots\.npy must hold only arrays, .*pathlib"),
        (code_in_parameters, r"3\.npy must hold only arrays, .*pathlib"),
        (no_parameters, "must hold new_params, smpl_params or params; got none"),
        (one_missing, r"7\.npy must be a readable file"),
        (no_joints, r"must hold lbs/joints\.npy or new_vertices, to know the joints; got neither"),
        (no_mask, r"Camera_B1/000004\.jpg must have a mask"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_broken_folders_say_what_is_wrong(original, tmp_path, breaking, message):
    path = tmp_path / "zju"
    shutil.copytree(original, path)
    breaking(path)
    with pytest.raises(BrokenDataset, match=message):
        open_zju_mocap(path)
