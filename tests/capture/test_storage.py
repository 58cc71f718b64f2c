"""Sequence folders: what is written is read, whole or not at all, and broken ones say why."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.errors import BrokenSequence
from capture.storage import open_sequence, read_quality
from scene import EXPRESSION_COUNT, FrameSource
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE, PoseTrust, read_frame
from tests.capture.sequences import HEIGHT, WIDTH, make_body, make_frames, surface, write_small

HALF_A_STEP = 0.5 / 255.0 + 1e-6
"""What eight bits may lose."""


@pytest.fixture
def folder(tmp_path) -> Path:
    return write_small(tmp_path / "seq")


def test_sequence_round_trips(tmp_path):
    rng = np.random.default_rng(3)
    train, unseen = make_frames(3, rng), make_frames(2, rng)
    body, confidence = make_body(surface=True), rng.random((3, 24))
    path = write_small(
        tmp_path / "seq", body=body, train=train, test={UNSEEN_POSE: unseen}, confidence=confidence
    )
    sequence = open_sequence(path)
    assert (sequence.person, sequence.frames_per_second, sequence.pose_trust) == (
        "somebody",
        10.0,
        PoseTrust.EXACT,
    )
    assert set(sequence.test) == {UNSEEN_POSE}
    for source, frames in ((sequence.train, train), (sequence.test[UNSEEN_POSE], unseen)):
        assert isinstance(source, FrameSource)
        assert len(source) == len(frames)
        for index, frame in enumerate(frames):
            read = read_frame(source, index)
            np.testing.assert_allclose(read.image, frame.image, atol=HALF_A_STEP)
            np.testing.assert_allclose(read.mask, frame.mask, atol=HALF_A_STEP)
            np.testing.assert_array_equal(read.camera.intrinsics, frame.camera.intrinsics)
            np.testing.assert_array_equal(read.camera.world_to_camera, frame.camera.world_to_camera)
            np.testing.assert_array_equal(read.pose.joint_angles, frame.pose.joint_angles)
            np.testing.assert_array_equal(read.pose.root_translation, frame.pose.root_translation)
            assert read.pose.time_s == frame.pose.time_s
    np.testing.assert_array_equal(sequence.motion.confidence, confidence)
    np.testing.assert_array_equal(sequence.body.skeleton.rest_joints, body.skeleton.rest_joints)
    for ours, theirs in zip(surface(sequence.body), surface(body), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_expressions_round_trip_and_old_folders_have_none(tmp_path):
    rng = np.random.default_rng(1)
    frames = [
        replace(f, pose=replace(f.pose, expression=rng.random(EXPRESSION_COUNT)))
        for f in make_frames(2, rng)
    ]
    shown = open_sequence(write_small(tmp_path / "seq", train=frames)).motion.expressions
    np.testing.assert_array_equal(shown, [frame.pose.expression for frame in frames])
    still = write_small(tmp_path / "still")
    with np.load(still / "motion.npz") as stored:
        assert "expressions" not in stored
    np.testing.assert_array_equal(
        open_sequence(still).motion.expressions, np.zeros((3, EXPRESSION_COUNT))
    )


def test_body_of_joints_alone_and_distortion_round_trip(tmp_path):
    bent = np.array([0.1, -0.02, 0.001, 0.002, 0.0])
    frames = make_frames(2, np.random.default_rng(0), bent)
    sequence = open_sequence(write_small(tmp_path / "seq", train=frames))
    assert not sequence.body.has_surface
    np.testing.assert_array_equal(sequence.train.camera(1).distortion, bent)


def test_frames_of_several_sizes_round_trip(tmp_path):
    frames = make_frames(3, np.random.default_rng(5))
    small = frames[1]
    camera = small.camera.cropped(2, 1, WIDTH - 4, HEIGHT - 3)
    cut = slice(1, HEIGHT - 2), slice(2, WIDTH - 2)
    frames[1] = replace(small, image=small.image[cut], mask=small.mask[cut], camera=camera)
    source = open_sequence(write_small(tmp_path / "seq", train=frames)).train
    sizes = [(source.camera(i).width, source.camera(i).height) for i in range(3)]
    assert sizes == [(WIDTH, HEIGHT), (WIDTH - 4, HEIGHT - 3), (WIDTH, HEIGHT)]
    np.testing.assert_allclose(source.image(1), frames[1].image, atol=HALF_A_STEP)


def test_pictures_are_read_only_when_asked_for(folder):
    shutil.rmtree(folder / "test" / NOVEL_VIEW / "images")
    sequence = open_sequence(folder)
    assert sequence.train.image(0).shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(BrokenSequence, match=r"images/000000\.png must be a picture; got no file"):
        sequence.test[NOVEL_VIEW].image(0)


def test_quality_is_written_when_all_frames_are(tmp_path):
    seen = []

    def frames():
        for frame in make_frames(3, np.random.default_rng(0)):
            seen.append(frame)
            yield frame

    path = write_small(tmp_path / "seq", train=frames(), quality=lambda: {"frames": len(seen)})
    assert read_quality(path) == {"frames": 3}


def test_failed_write_leaves_nothing(tmp_path):
    def cut():
        yield from make_frames(2, np.random.default_rng(0))
        raise OSError("No space left on device")

    with pytest.raises(OSError, match="No space left"):
        write_small(tmp_path / "seq", train=cut())
    assert list(tmp_path.iterdir()) == []


def test_existing_folder_is_never_overwritten(folder):
    before = open_sequence(folder).data_hash
    with pytest.raises(BrokenSequence, match=r"out must not exist yet; got .*seq; remove it"):
        write_small(folder, seed=1)
    assert open_sequence(folder).data_hash == before


def test_hash_names_what_is_learnt_from(tmp_path):
    one, same, other = (
        open_sequence(write_small(tmp_path / name, seed=seed, person=name))
        for name, seed in (("a", 0), ("b", 0), ("c", 1))
    )
    assert one.data_hash == same.data_hash  # the name of the person teaches nothing
    assert one.data_hash != other.data_hash
    assert len(one.data_hash) == 64


@pytest.mark.parametrize("name", ["images/000001.png", "masks/000002.png", "motion.npz"])
def test_hash_changes_with_every_byte(folder, name):
    before = open_sequence(folder).data_hash
    path = folder / name
    if path.suffix == ".npz":
        rewrite(path, root_translation=np.ones((3, 3)))
    else:
        path.write_bytes(path.read_bytes() + b"\0")
    assert open_sequence(folder).data_hash != before


def rewrite(path: Path, **arrays: np.ndarray | None) -> None:
    """Change arrays of an .npz; None removes one."""
    with np.load(path) as stored:
        kept = {**stored, **arrays}
    np.savez_compressed(path, **{k: v for k, v in kept.items() if v is not None})


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sequence.json", r"seq must be a sequence folder with a sequence\.json; got "),
        ("cameras.npz", r"cameras\.npz must be a readable \.npz file; got "),
        ("motion.npz", r"motion\.npz must be a readable \.npz file; got "),
        ("body.npz", r"body\.npz must be a readable \.npz file; got "),
        ("test/novel_view/cameras.npz", r"cameras\.npz must be a readable \.npz file; got "),
    ],
)
@pytest.mark.parametrize("how", ["missing", "empty", "cut", "text"])
def test_missing_and_torn_files_are_named(folder, name, message, how):
    path = folder / name
    if how == "missing":
        path.unlink()
    else:
        torn = {"empty": b"", "cut": path.read_bytes()[:60], "text": b"not what you think\n"}
        path.write_bytes(torn[how])
    with pytest.raises(BrokenSequence, match=message):
        open_sequence(folder)


def nan_angles() -> np.ndarray:
    angles = np.zeros((3, 24, 3))
    angles[1, 5, 2] = np.nan
    return angles


def flattened() -> np.ndarray:
    views = np.tile(np.eye(3, 4), (3, 1, 1))
    views[0, 2, :3] = 0.0
    return views


@pytest.mark.usefixtures("unchecked_annotations")
@pytest.mark.parametrize(
    ("name", "arrays", "message"),
    [
        (
            "motion.npz",
            {"joint_angles": nan_angles()},
            r"joint_angles must be finite; got nan at index \[1, 5, 2\]",
        ),
        ("motion.npz", {"joint_angles": np.zeros((3, 23, 3))}, "joint_angles must be"),
        ("motion.npz", {"joint_angles": np.full((3, 24, 3), "x")}, "angles must be real"),
        ("motion.npz", {"times_s": None}, "motion.npz must hold .*; times_s is missing"),
        ("motion.npz", {"times_s": np.array([0.0, 0.2, 0.1])}, "times_s must"),
        ("cameras.npz", {"world_to_camera": flattened()}, "world_to_camera must"),
        ("cameras.npz", {"intrinsics": np.zeros((3, 3, 3))}, "intrinsics must"),
        ("cameras.npz", {"intrinsics": np.full((3, 3, 3), np.inf)}, "intrinsics must be finite"),
        ("cameras.npz", {"world_to_camera": np.zeros((3, 3, 3))}, "world_to_camera must be 3 x 4"),
        ("cameras.npz", {"world_to_camera": np.tile(np.eye(3, 4), (2, 1, 1))}, "seq: "),
        ("cameras.npz", {"size": np.array([0, 8])}, "width"),
        ("cameras.npz", {"size": None}, "cameras.npz must hold .*; size is missing"),
        ("body.npz", {"rest_joints": np.zeros((23, 3))}, "body.npz: rest_joints must be 24 x 3"),
        ("body.npz", {"rest_vertices": np.zeros((4, 3))}, "body.npz: .*must be given together"),
    ],
)
def test_values_that_break_a_rule_are_named(folder, name, arrays, message):
    rewrite(folder / name, **arrays)
    with pytest.raises(BrokenSequence, match=message):
        open_sequence(folder)


@pytest.mark.parametrize("focal_px", [(0.0, 0.0), (0.0, 11.0), (10.0, 0.0), (-10.0, -11.0)])
def test_a_focal_length_must_be_positive(folder, focal_px):
    with np.load(folder / "cameras.npz") as stored:
        intrinsics = stored["intrinsics"].copy()
    intrinsics[1, [0, 1], [0, 1]] = focal_px
    rewrite(folder / "cameras.npz", intrinsics=intrinsics)
    said = f"positive focal lengths; got .* focal lengths {focal_px[0]:g}, {focal_px[1]:g} px"
    with pytest.raises(BrokenSequence, match=said):
        open_sequence(folder)


def test_one_camera_a_pose(folder):
    with np.load(folder / "cameras.npz") as stored:
        fewer = {k: v if k == "size" else v[:2] for k, v in stored.items()}
    np.savez_compressed(folder / "cameras.npz", **fewer)
    with pytest.raises(BrokenSequence, match="must have one camera a pose; got 2 and 3"):
        open_sequence(folder)


@pytest.mark.parametrize("version", [None, 0, 2, "1"])
def test_other_versions_are_refused(folder, version):
    about = json.loads((folder / "sequence.json").read_text())
    (folder / "sequence.json").write_text(json.dumps({**about, "version": version}))
    with pytest.raises(BrokenSequence, match=rf"must be version 1; got {version!r}; capture again"):
        open_sequence(folder)


@pytest.mark.parametrize("text", ["[]", "3", '"version"'])
def test_json_of_another_form_is_refused(folder, text):
    (folder / "sequence.json").write_text(text)
    with pytest.raises(BrokenSequence, match=r"sequence\.json must hold an object; got "):
        open_sequence(folder)


@pytest.mark.parametrize("rate", ["fast", None, 0, -5.0, float("nan"), float("inf")])
def test_frame_rate_must_be_positive(folder, rate):
    about = json.loads((folder / "sequence.json").read_text())
    (folder / "sequence.json").write_text(json.dumps({**about, "frames_per_second": rate}))
    with pytest.raises(BrokenSequence, match=r"frames_per_second in .* must be a positive"):
        open_sequence(folder)


@pytest.mark.parametrize(("kind", "read"), [("images", "image"), ("masks", "mask")])
def test_broken_pictures_are_named(folder, kind, read):
    path = folder / kind / "000001.png"
    whole = path.read_bytes()
    for content, got in ((b"", "0 bytes"), (whole[:40], "40 bytes"), (b"GIF89a", "6 bytes")):
        path.write_bytes(content)
        with pytest.raises(
            BrokenSequence, match=rf"{kind}/000001\.png must be a picture; got {got}"
        ):
            getattr(open_sequence(folder).train, read)(1)


def test_picture_of_another_size_is_refused(folder):
    rewrite(folder / "cameras.npz", size=np.array([WIDTH, HEIGHT + 1]))
    with pytest.raises(BrokenSequence, match=r"as large as its camera \(12 x 9\); got 12 x 8"):
        open_sequence(folder).train.image(0)
