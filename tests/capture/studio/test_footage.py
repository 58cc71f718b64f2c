"""Raw footage of the studio: the training frames as a camera records them, in front of a room."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.detection.landmarks import MediaPipeEstimator
from capture.errors import CaptureError
from capture.sources.archive import read_frames
from capture.sources.video import probe_video, read_video
from capture.storage import open_sequence
from capture.studio import Footage, make_sequence
from capture.studio.room import room_background
from scene import orbit_camera

FRAMES, SIZE = 5, 96


def film(folder: Path, raw: str, **seen_through) -> tuple[np.ndarray, Path]:
    """Footage [F H W 3] in 8-bit levels, and the sequence it belongs to."""
    path = folder / raw
    make_sequence(
        folder / f"{raw}.seq",
        frames=FRAMES,
        size=SIZE,
        test_cameras=1,
        seed=2,
        footage=Footage(path, **seen_through),
    )
    clip = read_video(path) if path.suffix else read_frames(path)
    return np.stack(clip.images).astype(np.float64), folder / f"{raw}.seq"


@pytest.fixture(scope="module")
def textured(tmp_path_factory) -> tuple[np.ndarray, Path]:
    return film(tmp_path_factory.mktemp("footage"), "room", background="textured")


def levels(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Images in 8-bit levels, and masks, of the training frames."""
    train = open_sequence(path).train
    images = np.stack([255.0 * train.image(i) for i in range(len(train))])
    return images, np.stack([train.mask(i) for i in range(len(train))])


def room_camera(size: int = 128):
    return orbit_camera(np.array([0.0, 0.9, 0.0]), 3.6, 0.0, 0.05, size, size, 0.6)


def test_plain_footage_is_the_sequence(tmp_path):
    frames, sequence = film(tmp_path, "plain")
    np.testing.assert_allclose(frames, levels(sequence)[0], atol=0.01)


def test_the_room_stands_still_behind_the_person(textured):
    frames, sequence = textured
    images, masks = levels(sequence)
    np.testing.assert_allclose(frames[masks == 1.0], images[masks == 1.0], atol=1.01)
    behind = (masks == 0.0).all(axis=0)
    assert np.ptp(frames[:, behind], axis=0).max() == 0.0
    assert np.abs(images[:, behind]).max() == 0.0


def test_the_room_has_clutter_of_moderate_contrast():
    light = cv2.cvtColor(room_background(room_camera(), 0), cv2.COLOR_RGB2GRAY)
    assert 0.05 < light.std() < 0.25
    edges = cv2.Canny((255.0 * light).astype(np.uint8), 40, 80) > 0
    assert 0.03 < edges.mean() < 0.3


def test_a_room_is_its_seed():
    first, again, other = (room_background(room_camera(48), seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).mean() > 0.02


def test_noise_has_its_strength_and_repeats(textured, tmp_path):
    clean, sequence = textured
    noisy, _ = film(tmp_path, "noisy", background="textured", noise=4.0)
    assert (noisy - clean).std() == pytest.approx(4.0, rel=0.05)
    assert (noisy[1] - clean[1] != noisy[0] - clean[0]).mean() > 0.8  # no fixed pattern
    again, _ = film(tmp_path, "again", background="textured", noise=4.0)
    np.testing.assert_array_equal(noisy, again)
    truth = open_sequence(tmp_path / "noisy.seq")
    assert truth.data_hash == open_sequence(sequence).data_hash  # the truth stays clean


def test_blur_is_a_gaussian_of_its_width(textured, tmp_path):
    clean, _ = textured
    soft, _ = film(tmp_path, "soft", background="textured", blur_px=1.5)
    expected = np.stack([cv2.GaussianBlur(frame, (0, 0), 1.5) for frame in clean])
    np.testing.assert_allclose(soft, expected, atol=1.01)


def test_an_open_shutter_smears_what_moves(textured, tmp_path):
    clean, sequence = textured
    smeared, _ = film(tmp_path, "smeared", background="textured", shutter=0.5)
    _, masks = levels(sequence)
    away = cv2.dilate(masks.max(axis=0), np.ones((25, 25))) == 0.0
    np.testing.assert_array_equal(smeared[:, away], clean[:, away])
    assert np.abs(smeared - clean)[masks > 0.0].mean() > 2.0


def test_a_video_is_near_lossless_and_has_the_rate(textured, tmp_path):
    clean, _ = textured
    path = tmp_path / "raw.mp4"
    make_sequence(
        tmp_path / "seq",
        frames=FRAMES,
        size=SIZE,
        test_cameras=1,
        seed=2,
        frames_per_second=25.0,
        footage=Footage(path, background="textured"),
    )
    assert probe_video(path).frames_per_second == pytest.approx(25.0)
    clip = read_video(path)
    sequence = open_sequence(tmp_path / "seq")
    np.testing.assert_allclose(clip.times_s, sequence.motion.times_s, atol=1e-3)
    error = np.stack(clip.images).astype(np.float64) - clean
    assert 20.0 * np.log10(255.0 / np.sqrt((error**2).mean())) > 42.0


def test_the_estimator_sees_a_human(pose_model, tmp_path):
    raw = tmp_path / "raw.mp4"
    make_sequence(
        tmp_path / "seq",
        look="lit",
        frames=12,
        size=512,
        test_cameras=1,
        seed=1,
        footage=Footage(raw, background="textured", noise=2.0, blur_px=0.6),
    )
    truth = open_sequence(tmp_path / "seq")
    found, near = 0, []
    with MediaPipeEstimator(pose_model) as estimator:
        for index, image in enumerate(read_video(raw).images):
            people = estimator.detect(image)
            found += len(people) == 1
            rows, columns = np.nonzero(truth.train.mask(index) > 0.5)
            box = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
            near += [np.abs(person.box - box).max() for person in people]
    assert found >= 11  # of 12
    assert np.median(near) < 40.0  # px: it is our performer, not a picture on the wall


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"background": "beach"}, "background must be one of black, textured; got 'beach'"),
        ({"noise": -1.0}, "noise must be between 0 and 64; got -1.0"),
        ({"blur_px": float("nan")}, "blur_px must be between 0 and 32; got nan"),
        ({"shutter": 1.5}, "shutter must be between 0 and 1; got 1.5"),
        ({"path": Path("raw.gif")}, r"footage must be a video .*; got raw\.gif"),
        ({"path": Path(__file__).parent}, "footage must not exist yet; got .*; remove it"),
    ],
)
def test_senseless_footage_is_refused(changed, message):
    with pytest.raises(CaptureError, match=message):
        Footage(**{"path": Path("raw"), **changed})


def test_footage_appears_whole_or_not_at_all(tmp_path):
    def stop(done: float, _: str) -> None:
        if done > 0.3:
            raise KeyboardInterrupt

    for name in ("raw", "raw.mp4"):
        with pytest.raises(KeyboardInterrupt):
            make_sequence(
                tmp_path / "seq",
                frames=FRAMES,
                size=48,
                test_cameras=1,
                on_progress=stop,
                footage=Footage(tmp_path / name, background="textured"),
            )
    assert list(tmp_path.iterdir()) == []
