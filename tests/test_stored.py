"""What the version of commit c51c977 stored is still read: tests/stored/README.md."""

from __future__ import annotations

import json
import sqlite3
import zipfile
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from safetensors import safe_open

from capture.sources.keypoints import read_keypoints
from capture.storage import open_sequence
from db import migrations
from db.models import Admission, RecordingState, Role
from renderer.field.settings import FAST
from renderer.field.sizes import GridSize, MlpSize
from renderer.model_files import load_model
from renderer.performer_model import PerformerModel
from renderer.presets import Preset
from renderer.splats.settings import SplatSettings
from renderer.training import train
from scene.expression import CURLS, GAZE
from scene.motion import Motion, Pose
from scene.sequence import NOVEL_VIEW, PoseTrust, Sequence
from services.app import create_app
from services.composition import build_services
from services.container import Services
from services.control.roster import roster_for
from services.motions import motion_of
from services.recording.replay import load
from services.settings import load_settings
from tests.services.conftest import SECRET, bearer

STORED = Path(__file__).parent / "stored"
VIEW, POSE = 2, 3
"""The test camera and the pose of the stored pictures."""
NOW = datetime(2026, 1, 1, 12, 0, tzinfo=UTC)
PRESETS = {
    "splats": (Preset("splats", "a few hundred splats", SplatSettings(count=400, most=400)), 120),
    "field": (
        Preset(
            "fast",
            "a coarse grid",
            replace(
                FAST,
                sizes=replace(
                    FAST.sizes,
                    grid=GridSize(0.04, 4, 0.04, 0.04),
                    volume=(8, 24, 24),
                    refiner=MlpSize(depth=2, width=64),
                ),
            ),
        ),
        40,
    ),
}
"""Sizes of the stored models, and the steps of the runs that were stopped."""


@pytest.fixture(scope="module")
def expected() -> dict[str, Any]:
    """What the code that wrote the files read from them."""
    return json.loads((STORED / "expected.json").read_text())


@pytest.fixture
def services(tmp_path: Path) -> Iterator[Services]:
    """Over the stored server's folder, migrated to the present schema."""
    with zipfile.ZipFile(STORED / "meeting.zip") as archive:
        archive.extractall(tmp_path / "data")
    with closing(sqlite3.connect(tmp_path / "data" / "metanerf.db")) as stored:
        assert stored.execute("SELECT version_num FROM alembic_version").fetchall() == [("0009",)]
        standings = stored.execute("SELECT standing FROM participant ORDER BY seat").fetchall()
        assert standings == [("admitted",), ("waiting",)]
    settings = load_settings(
        data_dir=tmp_path / "data", jwt_secret=SECRET, client_dir=tmp_path / "no-page"
    )
    made = build_services(settings)
    made.database.migrate()
    yield made
    made.close()


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    folder = tmp_path_factory.mktemp("stored") / "sequence"
    with zipfile.ZipFile(STORED / "sequence.zip") as archive:
        archive.extractall(folder)
    return open_sequence(folder)


def assert_reads_as(read: Motion | Pose, wanted: dict[str, Any]) -> None:
    for name, values in wanted.items():
        known = values if not name.startswith("expression") else finger_by_finger(np.array(values))
        np.testing.assert_allclose(getattr(read, name), known, atol=2e-6, err_msg=name)


def finger_by_finger(values: np.ndarray) -> np.ndarray:
    """Seven numbers, of which the last two close whole hands, and none turns the eyes."""
    assert values.shape[-1] == 7
    left, right = (np.stack([values[..., hand]] * 5, axis=-1) for hand in (5, 6))
    straight_ahead = np.zeros((*values.shape[:-1], 2))
    return np.concatenate([values[..., :5], straight_ahead, left, right], axis=-1)


def share_alike(model: PerformerModel, sequence: Sequence, name: str, levels: float) -> float:
    """Share of the pixels that differ from a stored picture by at most so many levels of 255."""
    picture = model.render(sequence.test[NOVEL_VIEW].camera(VIEW), model.motion.pose(POSE))
    stored = cv2.imread(str(STORED / f"{name}.png"), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    drawn_then = cv2.cvtColor(stored, cv2.COLOR_BGRA2RGBA)
    assert (drawn_then[..., 3] > 128).mean() > 0.03
    difference = np.abs(255.0 * np.clip(picture, 0.0, 1.0) - drawn_then).max(axis=-1)
    return float((difference <= levels).mean())


def test_a_sequence_folder_is_read(sequence, expected):
    wanted = expected["sequence"]
    for name in ("person", "frames_per_second", "data_hash"):
        assert getattr(sequence, name) == wanted[name], name
    assert (sequence.pose_trust is PoseTrust.EXACT) == wanted["exact_poses"]
    assert_reads_as(sequence.motion, wanted["motion"])
    assert sequence.motion.expressions.any()
    joints = sequence.body.skeleton.rest_joints
    np.testing.assert_allclose(joints, wanted["rest_joints"], atol=2e-6)
    directions = sequence.body.expression_directions
    assert directions is not None
    with zipfile.ZipFile(STORED / "sequence.zip") as archive, archive.open("body.npz") as stored:
        hands = np.load(stored)["expression_directions"][5:].astype(np.float64)
    fingers = directions[CURLS].reshape(2, 5, *hands.shape[1:])
    np.testing.assert_allclose(fingers.sum(axis=1), hands, atol=1e-9)
    assert not np.ptp(fingers, axis=1).any()
    assert not directions[CURLS.stop :].any()  # it knows no in-betweens
    assert not directions[GAZE].any()  # nor that eyes turn
    splits = {"train": sequence.train, **sequence.test}
    means = {
        name: [[split.image(i).mean(), split.mask(i).mean()] for i in range(len(split))]
        for name, split in splits.items()
    }
    assert set(means) == set(wanted["means"])
    for name, values in wanted["means"].items():
        np.testing.assert_allclose(means[name], values, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("kind", ["splats", "field"])
def test_a_model_draws_the_picture_that_it_drew(kind, sequence, expected):
    model = load_model(STORED / f"{kind}.safetensors")
    wanted = expected[kind]
    for name in ("preset", "data_hash", "metrics"):
        assert getattr(model, name) == wanted[name], name
    assert (model.kind, model.data_hash) == (kind, sequence.data_hash)
    assert_reads_as(model.motion, wanted["motion"])
    assert share_alike(model, sequence, kind, 2.0) >= 0.999


def test_fingers_that_close_together_close_the_hand_as_it_did():
    model = load_model(STORED / "splats.safetensors").splats
    assert model is not None
    with safe_open(str(STORED / "splats.safetensors"), framework="numpy") as stored:
        before = stored.get_tensor("expression_offsets").astype(np.float32)
    assert before.shape[1:] == (7, 3)
    np.testing.assert_array_equal(model.expression_offsets[:, :5], before[:, :5])
    hands = model.expression_offsets[:, CURLS].reshape(-1, 2, 5, 3).sum(axis=2)
    np.testing.assert_allclose(hands, before[:, 5:], atol=1e-6)


def test_the_light_that_was_found_is_read():
    splats = load_model(STORED / "splats.safetensors").splats
    assert splats is not None
    assert splats.light is not None
    assert splats.albedo is not None
    assert splats.normals is not None


def stopped_then(kind: str, sequence: Sequence, folder: Path) -> PerformerModel:
    """The model in whose training the stored checkpoint was found."""
    path = folder / "run.checkpoint"
    path.write_bytes((STORED / f"{kind}-stopped.checkpoint").read_bytes())
    preset, iterations = PRESETS[kind]
    model = train(
        sequence, preset=preset, iterations=iterations, clock=lambda: 0.0, checkpoint=path
    )
    assert model.metrics["steps"] == iterations
    return model


def test_a_stopped_field_goes_on(sequence, expected, tmp_path):
    wanted = expected["field-stopped"]
    model = stopped_then("field", sequence, tmp_path)
    assert wanted["step"] == 20
    assert model.metrics["steps"] == wanted["metrics"]["steps"]
    assert model.metrics["loss"] == pytest.approx(wanted["metrics"]["loss"], rel=0.1)
    # rounding differs between processors: whoever began anew is the measure of how far apart two
    # runs can come
    preset, iterations = PRESETS["field"]
    anew = train(sequence, preset=preset, iterations=iterations - 20, clock=lambda: 0.0)
    apart, anew_apart = (
        1.0 - share_alike(one, sequence, "field-stopped", 2.0) for one in (model, anew)
    )
    assert apart < 0.5 * anew_apart


def test_stopped_splats_which_lay_elsewhere_begin_anew(sequence, tmp_path):
    preset, iterations = PRESETS["splats"]
    model = stopped_then("splats", sequence, tmp_path).splats
    anew = train(sequence, preset=preset, iterations=iterations, clock=lambda: 0.0).splats
    assert model is not None
    assert anew is not None
    np.testing.assert_array_equal(model.parameters, anew.parameters)


@pytest.mark.parametrize("layout", ["smpl24", "mediapipe33"])
def test_keypoints_are_read(layout, expected):
    motion = read_keypoints(STORED / f"keypoints-{layout}.json")
    assert_reads_as(motion, expected["keypoints"][layout])


def test_a_database_is_brought_to_the_present_schema(services, expected):
    migrations.check(services.settings.database.url)
    wanted = expected["meeting"]
    with services.reading() as unit:
        meeting = unit.meetings.get(wanted["meeting_id"])
        person = unit.people.get(wanted["person_id"])
        motion = motion_of(services, unit, wanted["sequence_id"])
    assert (meeting.name, meeting.lobby, person.name) == ("Monday", True, "Ada")
    found = {one.id: [one.display_name, one.role, one.admission] for one in meeting.participants}
    assert found == wanted["participants"]
    assert [one.person_id for one in meeting.performers] == [person.id]
    assert_reads_as(motion, wanted["motion"])
    host = next(one for one in meeting.participants if one.role is Role.HOST)
    roster = roster_for(meeting, host.id, NOW)
    assert {one.name: one.admission for one in roster.members} == {
        "Ada": Admission.ADMITTED,
        "Bo": Admission.WAITING,
    }


def test_a_recording_is_replayed(services, expected):
    wanted = expected["meeting"]
    recorded = load(services, wanted["recording_id"])
    assert recorded.duration_s == wanted["duration_s"]
    assert [list(room) for room in recorded.rooms] == wanted["rooms"]
    times = {who: moments for who, (moments, _) in recorded.motions.items()}
    assert times == wanted["motion_times_ms"]
    voices = {
        who: [[one.at_ms, one.data.hex()] for one in spoken]
        for who, spoken in recorded.voices.items()
    }
    assert voices == wanted["voices"]
    (performer,) = recorded.scene_at(wanted["at_s"]).performers
    assert_reads_as(performer.pose, wanted["pose"])


async def test_a_recording_is_listed_and_downloaded(services, expected):
    wanted = expected["meeting"]
    transport = httpx.ASGITransport(create_app(services))
    async with httpx.AsyncClient(
        transport=transport, base_url="http://test", headers=bearer(services)
    ) as caller:
        listed = (await caller.get("/v1/recordings")).json()["items"]
        assert [one["id"] for one in listed] == [wanted["recording_id"]]
        answer = await caller.get(f"/v1/recordings/{wanted['recording_id']}")
        assert answer.status_code == 200, answer.text
        recording = answer.json()
        assert recording["state"] == RecordingState.ENDED
        assert recording["why_ended"] == "the host ended it"
        assert [one["name"] for one in recording["members"]] == ["Ada"]
        kinds = {one["name"].partition(":")[0] for one in recording["tracks"]}
        assert kinds == {"room", "motion", "voice", "chat"}
        for one in recording["tracks"]:
            assert (await caller.get(one["url"])).status_code == 200
        meeting = await caller.get(f"/v1/meetings/{wanted['meeting_id']}")
        assert [one["name"] for one in meeting.json()["performers"]] == ["Ada"]
