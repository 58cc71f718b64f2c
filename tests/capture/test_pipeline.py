"""From a clip to a sequence: with an estimator that knows the truth, and with the real one."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.body.expressions import FACE_NUMBERS
from capture.detection.network_files import HAND_MODEL, NetworkSource
from capture.errors import (
    BrokenSequence,
    CaptureStopped,
    NoPersonFound,
    PoseModelMissing,
    UnreadableClip,
)
from capture.fitting.result import Fit
from capture.overlay import project_surface, write_video
from capture.pipeline import CaptureOptions, capture_clip, capture_webcam
from capture.sources.clips import MIN_FRAMES
from capture.sources.video import read_video
from capture.storage import open_sequence, read_quality
from scene import PoseTrust
from scene.arrays import Array
from scene.errors import InvalidInput
from tests.capture.people import (
    FakeEstimator,
    body,
    camera,
    encoded,
    picture,
    seen_by,
    standing,
)
from tests.landmark_models import silent_server
from tests.shared_data import shared_data

FRAMES = 10
COLOUR, DIMMED = (200, 60, 40), (150, 45, 30)
DARK = (2, 5)
"""Frames that a camera exposed less than the others."""


@pytest.fixture(scope="module")
def people():
    motion = standing(FRAMES, turn_rad=0.6)
    return [seen_by(camera(), body(), motion.pose(i)) for i in range(FRAMES)]


@pytest.fixture(scope="module")
def estimator(people) -> FakeEstimator:
    return FakeEstimator({COLOUR: people})


@pytest.fixture(scope="module")
def zipped(people, tmp_path_factory):
    path = tmp_path_factory.mktemp("clip") / "frames.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for index, person in enumerate(people):
            archive.writestr(f"{index:03d}.png", encoded(picture(person, COLOUR)))
    return path


@pytest.fixture(scope="module")
def captured(zipped, estimator, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "seq"
    told: list[tuple[float, str]] = []
    quality = capture_clip(
        zipped,
        out,
        CaptureOptions(
            person="Ada",
            estimator=estimator,
            size_px=160,
            overlay=out.parent / "overlay.mp4",
        ),
        on_progress=lambda done, message: told.append((done, message)),
    )
    return out, quality, told


def test_a_zip_of_frames_becomes_a_sequence(captured, people):
    out, quality, _ = captured
    sequence = open_sequence(out)
    assert sequence.person == "Ada"
    assert len(sequence.train) == FRAMES == quality.frames_used
    assert sequence.pose_trust is PoseTrust.ESTIMATED
    assert sequence.body.has_surface
    frame = sequence.frame(3)
    assert max(frame.image.shape[:2]) == 160
    assert frame.camera.width == frame.image.shape[1]
    inside = frame.image[frame.mask > 0.99]
    assert inside.mean(axis=0) == pytest.approx(np.array(COLOUR) / 255.0, abs=0.03)


def test_the_stored_cameras_see_the_body_on_its_mask(captured):
    sequence = open_sequence(captured[0])
    for index in (0, FRAMES - 1):
        frame = sequence.frame(index)
        covered = project_surface(frame.camera, sequence.body, frame.pose) > 0
        mask = frame.mask > 0.5
        assert (covered & mask).sum() / (covered | mask).sum() > 0.8


def test_the_quality_report_is_stored(captured):
    out, quality, _ = captured
    assert read_quality(out) == quality.as_json()
    assert quality.landmark_error_px < 3.0
    assert quality.coverage["front"] > 0.5


def test_the_overlay_shows_the_whole_pictures(captured):
    out, quality, _ = captured
    clip = read_video(out.parent / "overlay.mp4")
    assert len(clip.images) == quality.frames_used
    corner = clip.images[0][:8, :8].mean(axis=(0, 1))
    np.testing.assert_allclose(corner, 120.0, atol=12.0)  # the grey wall, which is not stored


def height_px(mask: Array) -> int:
    return int(np.ptp(np.flatnonzero((mask > 0.5).any(axis=1)))) + 1


@pytest.mark.usefixtures("fewer_steps")
def test_a_draft_shows_the_person_before_the_fit_is_finished(zipped, estimator, tmp_path):
    stages: list[str] = []
    drafts: list[tuple[int, float, tuple[int, int]]] = []

    def on_draft(folder: Path) -> None:
        draft = open_sequence(folder)
        frame = draft.frame(3)
        covered = project_surface(frame.camera, draft.body, frame.pose) > 0
        person = frame.mask > 0.5
        overlap = float((covered & person).sum() / (covered | person).sum())
        drafts.append((len(stages), overlap, (len(draft.train), frame.camera.width)))

    def on_fit(stage: str, _: Fit) -> None:
        stages.append(stage)

    options = CaptureOptions(person="p", estimator=estimator)
    capture_clip(zipped, tmp_path / "out", options, on_fit=on_fit, on_draft=on_draft)
    stored = open_sequence(tmp_path / "out").frame(3)
    ((stage, overlap, size),) = drafts
    assert (stage, size) == (2, (FRAMES, stored.camera.width))
    assert overlap > 0.75
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.usefixtures("fewer_steps")
@pytest.mark.parametrize("container", ["clip", "clip.zip"])
def test_a_large_clip_is_stored_as_large_as_filmed_and_its_draft_is_small(
    container, tmp_path, monkeypatch
):
    monkeypatch.setattr("capture.pipeline.MAX_SIDE_PX", 128)
    # a flat colour and the same, exposed less, have nothing in common; filmed clothes do
    monkeypatch.setattr("capture.detection.tracking.SAME_PERSON", -1.0)
    motion = standing(MIN_FRAMES)
    fitted, filmed = (
        [seen_by(camera(size), body(), motion.pose(index)) for index in range(MIN_FRAMES)]
        for size in (128, 160)
    )
    (tmp_path / "clip").mkdir()
    for index, person in enumerate(filmed):
        exposed = picture(person, COLOUR) * (0.75 if index in DARK else 1.0)
        (tmp_path / "clip" / f"{index:03d}.png").write_bytes(encoded(exposed.astype(np.uint8)))
    with zipfile.ZipFile(tmp_path / "clip.zip", "w") as archive:
        for path in sorted((tmp_path / "clip").iterdir()):
            archive.write(path, path.name)
    drafts: list[tuple[int, float]] = []
    options = CaptureOptions(person="p", estimator=FakeEstimator({COLOUR: fitted, DIMMED: fitted}))
    out = tmp_path / "out" / "seq"
    capture_clip(
        tmp_path / container, out, options, on_draft=lambda folder: drafts.append(shown_in(folder))
    )
    ((tall_px, overlap),) = drafts
    assert tall_px == pytest.approx(height_px(fitted[0].mask), abs=3)
    assert overlap > 0.75
    tall_px, overlap = shown_in(out)
    assert tall_px == pytest.approx(height_px(filmed[0].mask), abs=4)
    assert overlap > 0.8
    for index in DARK:
        frame = open_sequence(out).frame(index)
        inside = frame.image[frame.mask > 0.99].mean(axis=0)
        assert inside == pytest.approx(np.array(COLOUR) / 255.0, abs=0.03)


def shown_in(folder: Path) -> tuple[int, float]:
    """How tall (px) the person of a sequence's first frame is, and how far the body covers them."""
    sequence = open_sequence(folder)
    frame = sequence.frame(0)
    covered = project_surface(frame.camera, sequence.body, frame.pose) > 0
    person = frame.mask > 0.5
    return height_px(frame.mask), float((covered & person).sum() / (covered | person).sum())


def test_an_overlay_must_be_an_mp4(zipped, estimator, tmp_path):
    for name in ("overlay.gif", "nowhere/overlay.mp4"):
        options = CaptureOptions(person="p", estimator=estimator, overlay=tmp_path / name)
        with pytest.raises(InvalidInput, match=r"overlay must be an \.mp4 file in a folder"):
            capture_clip(zipped, tmp_path / "seq", options)


@pytest.mark.parametrize("focal_px", [0.0, -5.0, np.inf, np.nan])
def test_no_lens_has_such_a_focal_length(zipped, estimator, tmp_path, focal_px: float):
    options = CaptureOptions(person="Ada", estimator=estimator, focal_px=focal_px)
    with pytest.raises(InvalidInput, match=r"focal_px must be positive.*leave it out"):
        capture_clip(zipped, tmp_path / "out", options)
    assert not (tmp_path / "out").exists()


def test_progress_rises_and_names_the_stages(captured):
    told = captured[2]
    shares = [done for done, _ in told]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert {"finding the person", "fitting the body"} <= {message for _, message in told}


def test_an_existing_folder_is_never_overwritten(zipped, estimator, tmp_path):
    (tmp_path / "seq").mkdir()
    with pytest.raises(BrokenSequence, match="out must not exist yet"):
        capture_clip(zipped, tmp_path / "seq", CaptureOptions(person="p", estimator=estimator))


def _nothing_left(folder) -> bool:
    return [p.name for p in folder.iterdir() if "out" in p.name] == []


def test_a_text_file_named_mp4_leaves_nothing(tmp_path, estimator):
    path = tmp_path / "story.mp4"
    path.write_text("once upon a time")
    with pytest.raises(UnreadableClip, match="must be a video"):
        capture_clip(path, tmp_path / "out", CaptureOptions(person="p", estimator=estimator))
    assert _nothing_left(tmp_path)


def test_a_clip_without_a_person_leaves_nothing(tmp_path, estimator):
    path = tmp_path / "wall.mp4"
    write_video([np.full((64, 64, 3), 100 + i, dtype=np.uint8) for i in range(20)], path, 30)
    with pytest.raises(NoPersonFound):
        capture_clip(path, tmp_path / "out", CaptureOptions(person="p", estimator=estimator))
    assert _nothing_left(tmp_path)


def test_too_few_frames_are_refused_with_both_numbers(tmp_path, people, estimator):
    for index in range(3):
        (tmp_path / f"{index}.png").write_bytes(encoded(picture(people[index], COLOUR)))
    with pytest.raises(UnreadableClip, match="at least 8 frames; got 3"):
        capture_clip(tmp_path, tmp_path / "out", CaptureOptions(person="p", estimator=estimator))


def test_a_person_seen_too_rarely_is_refused_with_both_numbers(tmp_path, people, estimator):
    wall = np.full((256, 256, 3), 120, dtype=np.uint8)
    for index in range(40):
        image = picture(people[index % FRAMES], COLOUR) if index % 8 == 0 else wall
        (tmp_path / f"{index}.png").write_bytes(encoded(image))
    with pytest.raises(NoPersonFound, match="at least 10 of 40 frames; got 5"):
        capture_clip(tmp_path, tmp_path / "out", CaptureOptions(person="p", estimator=estimator))


@pytest.mark.parametrize("stage", ["reading", "finding", "fitting"])
def test_a_stop_leaves_nothing(zipped, estimator, tmp_path, stage):
    at = ""

    def note(_: float, message: str) -> None:
        nonlocal at
        at = message

    with pytest.raises(CaptureStopped):
        capture_clip(
            zipped,
            tmp_path / "out",
            CaptureOptions(person="p", estimator=estimator),
            on_progress=note,
            should_stop=lambda: stage in at,
        )
    assert _nothing_left(tmp_path)


def test_models_that_are_not_there_are_named(zipped, pose_model, tmp_path):
    absent = tmp_path / "absent.task"
    with pytest.raises(InvalidInput, match="a pose_model or an estimator"):
        capture_clip(zipped, tmp_path / "out", CaptureOptions(person="p"))
    with pytest.raises(PoseModelMissing, match="set METANERF_POSE_MODEL"):
        capture_clip(zipped, tmp_path / "out", CaptureOptions(person="p", pose_model=absent))
    options = CaptureOptions(person="p", pose_model=pose_model, face_model=absent)
    with pytest.raises(PoseModelMissing, match="set METANERF_FACE_MODEL"):
        capture_clip(zipped, tmp_path / "out", options)
    assert _nothing_left(tmp_path)


@pytest.mark.usefixtures("fewer_steps")
def test_a_real_clip_with_others_behind_becomes_a_sequence(pose_model, tmp_path):
    clip = shared_data("real-two-cameras/cam01.mp4")
    options = CaptureOptions(person="p", pose_model=pose_model, max_frames=12)
    quality = capture_clip(clip, tmp_path / "out", options)
    assert quality.frames_used == 12
    assert quality.mask_overlap > 0.78
    assert quality.landmark_error < 0.015
    assert quality.joints_in_mask > 0.95
    assert quality.legs_seen
    sequence = open_sequence(tmp_path / "out")
    for index in (0, 6, 11):
        frame = sequence.frame(index)
        # one whole person, and nobody of the background: the mask is one piece around the pelvis
        pelvis = frame.pose.root_translation + sequence.body.skeleton.rest_joints[0]
        pixel, _ = frame.camera.project(pelvis)
        assert frame.mask[int(pixel[1]), int(pixel[0])] > 0.9
        assert 0.03 < (frame.mask > 0.5).mean() < 0.5


def test_an_upper_body_is_captured_standing(pose_model, face_model, tmp_path):
    clip = shared_data("real-monocular/webcam_upperbody_woman_asl.mp4")
    with silent_server() as address:
        away = replace(HAND_MODEL, url=f"{address}/m.task")
        hands = NetworkSource(folder=tmp_path / "kept", model=away)
        options = CaptureOptions(
            person="p",
            pose_model=pose_model,
            max_frames=10,
            face_model=face_model,
            hand_model=hands,
        )
        quality = capture_clip(clip, tmp_path / "out", options)
    assert not quality.legs_seen
    assert any("upper body" in line for line in quality.advice)
    assert quality.mask_overlap > 0.8
    sequence = open_sequence(tmp_path / "out")
    joints = sequence.body.skeleton.joint_transforms(
        sequence.motion.joint_angles, sequence.motion.root_translation
    )[..., :3, 3]
    assert joints[:, 15, 1].min() > 1.35  # the head is up
    assert joints[:, [7, 8], 1].max() < 0.25  # the feet are down
    # her lids move; the model that tells of hands could not be had
    assert sequence.motion.expressions[:, :FACE_NUMBERS].any()
    assert not sequence.motion.expressions[:, FACE_NUMBERS:].any()


def test_no_webcam_is_told_with_its_number(tmp_path):
    options = CaptureOptions(person="p", pose_model=NetworkSource())
    with pytest.raises(UnreadableClip, match="webcam 63 must be one that can be opened"):
        capture_webcam(63, tmp_path / "out", options)
    assert not (tmp_path / "out").exists()


def test_a_model_that_is_not_where_it_was_said_is_told_before_anybody_films(tmp_path):
    options = CaptureOptions(
        person="p", pose_model=NetworkSource(), face_model=tmp_path / "absent.task"
    )
    with pytest.raises(PoseModelMissing, match=r"face model must be a file; got .*absent"):
        capture_webcam(63, tmp_path / "out", options)
