"""What is stored of a clip: the frames that show the person, cropped round them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from capture.captured import CapturedClip, crop_to_person, person_window
from capture.detection.tracking import Track
from capture.errors import NoPersonFound
from capture.fitting.result import Fit
from capture.fitting.world import PlacedFit
from capture.sources.video import shrink
from scene.arrays import Array
from scene.camera import Camera
from tests.capture.people import body, camera, picture, seen_by, standing

FRAMES, LOST = 5, 2
MOTION = standing(FRAMES, turn_rad=0.5)
PEOPLE = [seen_by(camera(), body(), MOTION.pose(frame)) for frame in range(FRAMES)]
TRACK = Track(
    tuple(None if frame == LOST else person for frame, person in enumerate(PEOPLE)),
    (0, 0, 0, 1, 1),
)
MASKS = [None if frame == LOST else person.mask for frame, person in enumerate(PEOPLE)]
IMAGES = [picture(person) for person in PEOPLE]


def cropped(size_px: int, masks: list[Array | None] = MASKS, finer: int = 1) -> CapturedClip:
    """A clip whose fit is the truth, but for landmarks that lie `frame` px off; it was filmed
    `finer` times as large as it was fitted."""
    error = np.repeat(np.arange(float(FRAMES))[:, None], 33, 1)
    error[LOST] = np.nan
    fit = Fit(
        body(),
        camera().focal_px,
        MOTION.joint_angles,
        MOTION.root_translation,
        error,
        np.ones((FRAMES, 33)),
        None,
        np.array([0.0, 1.0, 0.0]),
    )
    placed = PlacedFit(body(), MOTION, camera().world_to_camera, legs_seen=True)
    filmed = (finer * camera().width, finer * camera().height)
    window = person_window(masks, filmed)
    images = [shrink(cv2.resize(image, filmed)[window], size_px) for image in IMAGES]
    return crop_to_person(images, window, filmed, TRACK, masks, fit, placed)


def test_frames_in_which_the_person_was_lost_are_left_out():
    clip = cropped(1000)
    kept = [frame for frame in range(FRAMES) if frame != LOST]
    assert len(clip.images) == len(clip.masks) == len(kept)
    np.testing.assert_array_equal(clip.motion.times_s, MOTION.times_s[kept])
    np.testing.assert_array_equal(clip.motion.joint_angles, MOTION.joint_angles[kept])
    np.testing.assert_array_equal(clip.landmark_error_px[:, 0], [0.0, 1.0, 3.0, 4.0])
    assert (clip.frames_lost, clip.takes) == (1, 2)


def test_the_person_of_all_frames_is_inside_and_little_else():
    clip = cropped(1000)
    assert sum(mask.sum() for mask in clip.masks) == sum(m.sum() for m in MASKS if m is not None)
    ever = np.max(clip.masks, axis=0) > 0.5
    tall, wide = (np.ptp(np.flatnonzero(ever.any(axis=axis))) + 1 for axis in (1, 0))
    height, width = ever.shape
    assert tall < height < 1.15 * tall
    assert wide < width < wide + 0.15 * tall
    assert all(image.shape[:2] == ever.shape for image in clip.images)


@pytest.mark.parametrize("size_px", [60, 100, 1000])
def test_pictures_are_made_smaller_never_larger(size_px):
    whole, clip = cropped(1000), cropped(size_px)
    longest = max(clip.images[0].shape[:2])
    assert longest == min(size_px, max(whole.images[0].shape[:2]))
    share = longest / max(whole.images[0].shape[:2])
    np.testing.assert_allclose(clip.landmark_error_px, share * whole.landmark_error_px)


@pytest.mark.parametrize(("size_px", "finer"), [(60, 1), (1000, 1), (1000, 3), (300, 3)])
def test_the_camera_sees_the_person_where_the_picture_does(size_px, finer):
    clip = cropped(size_px, finer=finer)
    assert (clip.camera.height, clip.camera.width) == clip.images[0].shape[:2]
    for index, mask in enumerate(clip.masks):
        joints = body().skeleton.joint_transforms(
            clip.motion.joint_angles[index], clip.motion.root_translation[index]
        )[:22, :3, 3]
        pixels, _ = clip.camera.project(joints)
        column, row = pixels.astype(int).T
        assert (mask[row, column] > 0.5).mean() > 0.9
    # both corners of a picture are the same rays as before
    assert seen_along(clip.camera, (0.0, 0.0)) == pytest.approx(
        seen_along(camera(), corner_of(clip.camera)), abs=0.01
    )


def test_pictures_filmed_larger_than_they_were_fitted_are_stored_so():
    fitted, filmed = cropped(1000), cropped(1000, finer=3)
    assert filmed.images[0].shape[0] == pytest.approx(3 * fitted.images[0].shape[0], abs=3)
    assert filmed.camera.focal_px == pytest.approx(3.0 * fitted.camera.focal_px)
    np.testing.assert_allclose(filmed.landmark_error_px, 3.0 * fitted.landmark_error_px)
    for image, mask in zip(filmed.images, filmed.masks, strict=True):
        assert mask.shape == image.shape[:2]
        red = (image == [200, 60, 40]).all(axis=2)
        assert (red == (mask > 0.5)).mean() > 0.99


def test_a_shrunk_clip_is_the_same_seen_in_smaller_pictures():
    whole, small = cropped(1000), cropped(1000).shrunk(100)
    assert max(small.images[0].shape[:2]) == 100
    share = 100.0 / max(whole.images[0].shape[:2])
    assert small.camera.focal_px == pytest.approx(share * whole.camera.focal_px, rel=0.01)
    np.testing.assert_allclose(small.landmark_error_px, share * whole.landmark_error_px, rtol=0.01)
    assert [mask.shape for mask in small.masks] == [image.shape[:2] for image in small.images]


def seen_along(view: Camera, pixel: tuple[float, float]) -> Array:
    """Direction of the ray through `pixel`, on the plane z = 1 of the camera."""
    return np.linalg.solve(view.intrinsics, [*pixel, 1.0])[:2]


def corner_of(view: Camera) -> tuple[float, float]:
    """Where the cropped picture's first corner lies in the whole one."""
    scale = view.focal_px / camera().focal_px
    x, y = camera().intrinsics[:2, 2] - view.intrinsics[:2, 2] / scale
    return float(x), float(y)


def test_of_each_stored_picture_only_the_person_is_kept():
    clip = cropped(1000)
    shares: list[float] = []
    frames = list(clip.frames(shares.append))
    assert shares == [0.0, 0.25, 0.5, 0.75]
    for frame, mask in zip(frames, clip.masks, strict=True):
        assert not frame.image[mask == 0.0].any()
        inside = frame.image[mask == 1.0]
        np.testing.assert_allclose(
            inside, np.broadcast_to([200, 60, 40], inside.shape) / 255.0, atol=0.02
        )
    assert [frame.pose.time_s for frame in frames] == list(clip.motion.times_s)


def test_overlays_show_the_whole_picture():
    clip = cropped(1000)
    drawn = list(clip.overlays())
    assert len(drawn) == len(clip.images)
    for overlay, image, mask in zip(drawn, clip.images, clip.masks, strict=True):
        assert overlay.shape == image.shape
        assert (overlay[0, 0] == image[0, 0]).all()
        assert (overlay != image).any(axis=2)[mask > 0.5].any()


def test_a_clip_whose_masks_are_all_empty_shows_nobody():
    empty = [None if mask is None else np.zeros_like(mask) for mask in MASKS]
    with pytest.raises(NoPersonFound, match="mask must not be empty; got nothing in any frame"):
        cropped(100, empty)
