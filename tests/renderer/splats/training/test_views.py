"""Training frames from files are those that `image` and `mask` tell of, to the bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.foreign.dataset import TRAIN, write_dataset
from capture.errors import BrokenDataset
from capture.sources.readers import open_folder
from capture.sources.readers.frames import DatasetFrames, to_integer_pixel_centres
from capture.storage import FolderFrames, open_sequence, write_sequence
from renderer.splats.training.views import View, read_views
from scene.sequence import CropSource, FrameSource, PoseTrust, read_frame

FRAMES = 12
LENS = np.array([-0.2, 0.06, 0.002, -0.001, 0.0])


class FloatFrames:
    """A source that tells of whole pictures alone."""

    def __init__(self, source: FrameSource) -> None:
        self.source = source
        self.camera, self.pose = source.camera, source.pose
        self.image, self.mask = source.image, source.mask

    def __len__(self) -> int:
        return len(self.source)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("foreign")
    write_dataset(path, 96, FRAMES)
    return path / TRAIN


@pytest.fixture
def frames(folder: Path) -> DatasetFrames:
    source = open_folder(folder).train
    assert isinstance(source, DatasetFrames)
    return source


def require_same(read: list[View], expected: list[View]) -> None:
    assert len(read) == len(expected)
    for one, other in zip(read, expected, strict=True):
        assert np.array_equal(one.rgba, other.rgba)
        assert one.rgba.flags.c_contiguous
        assert np.array_equal(one.camera, other.camera)


def read_grey(path: Path) -> np.ndarray:
    pixels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert pixels is not None
    return pixels


def distorted(frames: DatasetFrames) -> DatasetFrames:
    lens = (to_integer_pixel_centres(frames.camera(0).intrinsics), LENS)
    return replace(frames, frames=[replace(one, lens=lens) for one in frames.frames])


def test_frames_of_a_data_set_are_equal_to_the_bit_and_in_order(frames: DatasetFrames):
    assert isinstance(frames, CropSource)
    assert not isinstance(FloatFrames(frames), CropSource)
    require_same(read_views(frames), read_views(FloatFrames(frames)))


def test_undistorted_frames_are_equal_to_the_bit(frames: DatasetFrames):
    bent = distorted(frames)
    require_same(read_views(bent), read_views(FloatFrames(bent)))
    plain = read_grey(frames.frames[3].masks[0])
    lens = bent.frames[3].lens
    assert lens is not None
    expected = cv2.undistort(plain, *lens)
    assert np.array_equal(np.round(255.0 * bent.mask(3)).astype(np.uint8), expected)
    assert not np.array_equal(plain, expected)


def test_frames_of_a_sequence_folder_are_equal_to_the_bit(folder: Path, tmp_path: Path):
    clip = open_folder(folder)
    write_sequence(
        tmp_path / "clip",
        person="p",
        frames_per_second=30.0,
        body=clip.body,
        train=(read_frame(clip.train, i) for i in range(FRAMES)),
        source="test",
        pose_trust=PoseTrust.EXACT,
    )
    source = open_sequence(tmp_path / "clip").train
    assert isinstance(source, FolderFrames)
    require_same(read_views(source), read_views(FloatFrames(source)))


def test_masks_that_write_one_for_the_person_count(frames: DatasetFrames, tmp_path: Path):
    path = tmp_path / "mask.png"
    mask = read_grey(frames.frames[0].masks[0])
    cv2.imwrite(str(path), (mask > 127).astype(np.uint8))
    ones = replace(frames, frames=[replace(frames.frames[0], masks=(path,))], pose_indices=[0])
    (view,) = read_views(ones)
    assert set(np.unique(view.rgba[..., 3])) == {0, 255}
    require_same([view], read_views(FloatFrames(ones)))


def test_a_frame_without_a_person_is_kept_whole(frames: DatasetFrames, tmp_path: Path):
    path = tmp_path / "mask.png"
    cv2.imwrite(str(path), np.zeros((96, 96), np.uint8))
    nobody = replace(frames, frames=[replace(frames.frames[0], masks=(path,))], pose_indices=[0])
    (view,) = read_views(nobody)
    assert view.rgba.shape == (96, 96, 4)
    assert not view.rgba.any()


def test_a_view_cut_or_resized_shows_the_same_rays(frames: DatasetFrames):
    view = read_views(frames)[0]
    height, width = view.rgba.shape[:2]
    point = view.window.unproject(np.array([0.4 * width, 0.3 * height]), np.array(2.0))
    small = view.resized(0.5)
    assert small.rgba.shape == (round(0.5 * height), round(0.5 * width), 4)
    pixel, _ = small.window.project(point)
    np.testing.assert_allclose(pixel / small.rgba.shape[1::-1], [0.4, 0.3])
    assert view.resized(1.0) is view
    for x, y in ((0, 0), (width // 2, height // 3), (10**6, -(10**6))):
        part = view.cut(x, y, 16)
        assert part.rgba.shape == (16, 16, 4)
        assert part.rgba.flags.c_contiguous
        shift = (view.window.project(point)[0] - part.window.project(point)[0]).round().astype(int)
        left, top = shift.tolist()
        assert np.array_equal(part.rgba, view.rgba[top : top + 16, left : left + 16])
    assert view.cut(0, 0, 10**4).rgba.shape == view.rgba.shape


def test_what_a_thread_cannot_read_is_told_by_file_and_frame(frames: DatasetFrames, tmp_path: Path):
    broken = tmp_path / "frame_000005.png"
    broken.write_bytes(b"no picture")
    shots = list(frames.frames)
    shots[5] = replace(shots[5], picture=broken)
    with pytest.raises(BrokenDataset, match=r"frame_000005\.png must be a picture") as caught:
        read_views(replace(frames, frames=shots))
    assert caught.value.__notes__ == ["in training frame 5"]
