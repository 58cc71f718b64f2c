"""Write the files of this folder with the code of commit c51c977, whose modules it imports.

Run it in a checkout of that commit, as README.md says: `make.py FOLDER`.
"""

from __future__ import annotations

import asyncio
import json
import shutil
import sys
import tempfile
import time
import zipfile
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np

from capture.body import load_body_model
from capture.fit_initial import TO_Y_UP
from capture.fit_landmarks import load_landmark_model
from capture.keypoints import read_keypoints
from capture.store import open_sequence
from capture.studio import make_sequence
from db.models import (
    MessageKind,
    MessageRow,
    MotionRow,
    ParticipantRow,
    Role,
    SequenceKind,
    SequenceRow,
    SequenceState,
    new_id,
)
from renderer.checkpoint import load_model, save_model
from renderer.errors import TrainingStopped
from renderer.field.settings import FAST
from renderer.field.sizes import GridSize, MlpSize
from renderer.presets import Preset
from renderer.splats.settings import SplatSettings
from renderer.training import train
from scene.expression import EXPRESSION_COUNT
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix, matrix_to_quaternion
from scene.sequence import NOVEL_VIEW, PoseTrust, Sequence
from services.auth import ALL_SCOPES, Principal
from services.bootstrap import import_model
from services.composition import build_services
from services.container import Services
from services.control.roster import present_in, standing_for
from services.live.forwarding import OpusPacket
from services.live.packets import PosePacket, encode_pose, performer_check
from services.meetings import create_meeting
from services.motions import motion_bytes
from services.recording import consent
from services.recording.recorder import Recorders
from services.recording.replay import load
from services.seats import take_seat
from services.settings import load_settings

SPLATS = Preset("splats", "a few hundred splats", SplatSettings(count=400))
FIELD = Preset(
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
)
VIEW, POSE = 2, 3
"""The test camera and the pose that pictures of models are drawn with."""
ITERATIONS = 120
NOW = datetime(2026, 1, 1, 12, 0, tzinfo=UTC)
OPUS_SILENCE = bytes([0xF8, 0xFF, 0xFE])


def ticking():
    """A clock that moves on by a hundredth of a second at every look."""
    now_s = 0.0

    def clock() -> float:
        nonlocal now_s
        now_s += 0.01
        return now_s

    return clock


def zip_folder(folder: Path, out: Path) -> None:
    """Every file of `folder`, with the same dates whenever it is run."""
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file() and path.suffix != ".lock":
                entry = zipfile.ZipInfo(str(path.relative_to(folder)))
                archive.writestr(entry, path.read_bytes(), zipfile.ZIP_DEFLATED, 9)


def described(motion: Motion) -> dict:
    """What a motion must be read as."""
    parts = ("times_s", "joint_angles", "root_translation", "expressions")
    return {name: np.round(getattr(motion, name), 6).tolist() for name in parts}


def make_session(work: Path, out: Path) -> tuple[Sequence, dict]:
    """A performer who talks and moves their fingers, for the most fields of a sequence."""
    folder = work / "sequence"
    make_sequence(folder, frames=8, size=64, test_cameras=4, expressions=True)
    zip_folder(folder, out / "sequence.zip")
    clip = open_sequence(folder)
    splits = {"train": clip.train, **clip.test}
    return clip, {
        "person": clip.person,
        "frames_per_second": clip.frames_per_second,
        "data_hash": clip.data_hash,
        "exact_poses": clip.pose_trust is PoseTrust.EXACT,
        "motion": described(clip.motion),
        "rest_joints": np.round(clip.body.skeleton.rest_joints, 6).tolist(),
        "means": {
            name: [
                [float(split.image(i).mean()), float(split.mask(i).mean())]
                for i in range(len(split))
            ]
            for name, split in splits.items()
        },
    }


def make_model(clip: Sequence, preset: Preset, out: Path, **options) -> dict:
    """A model file, and the picture that the file's own model draws: premultiplied, RGBA."""
    save_model(train(clip, preset=preset, clock=ticking(), **options), out)
    model = load_model(out)
    picture = model.render(clip.test[NOVEL_VIEW].camera(VIEW), model.motion.pose(POSE))
    pixels = np.rint(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)
    cv2.imwrite(str(out.with_suffix(".png")), cv2.cvtColor(pixels, cv2.COLOR_RGBA2BGRA))
    return {
        "preset": model.preset,
        "data_hash": model.data_hash,
        "metrics": model.metrics,
        "motion": described(model.motion),
    }


def make_checkpoint(work: Path, clip: Sequence, preset: Preset, iterations: int, out: Path) -> dict:
    """A run that was stopped after 20 steps, and the picture of the model that it ended with."""
    path = out.with_suffix(".checkpoint")
    path.unlink(missing_ok=True)
    with suppress(TrainingStopped):
        train(
            clip,
            preset=preset,
            iterations=iterations,
            clock=ticking(),
            checkpoint=path,
            should_stop=lambda: True,
        )
    with np.load(path) as stored:
        about = json.loads(str(stored["about"]))
    resumed = work / f"{out.name}.safetensors"
    about["metrics"] = make_model(clip, preset, resumed, iterations=iterations, checkpoint=path)[
        "metrics"
    ]
    shutil.copy(resumed.with_suffix(".png"), out.with_suffix(".png"))
    return about


def make_keypoints(motion: Motion, out: Path) -> dict:
    """Both layouts of a few frames of `motion`."""
    body = load_body_model().body(np.zeros(load_body_model().shape_count))
    marks = load_landmark_model()
    smpl, mediapipe = [], []
    for index in range(4):
        pose = motion.pose(index)
        moved = body.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
        own = moved[marks.joints]
        points = np.einsum("nij,nj->ni", own[:, :3, :3], marks.rest) + own[:, :3, 3]
        points = (points - points[[23, 24]].mean(axis=0)) * TO_Y_UP
        smpl.append(
            {
                "time_s": float(pose.time_s),
                "joint_angles": np.round(pose.joint_angles, 5).tolist(),
                "root_translation": np.round(pose.root_translation, 5).tolist(),
            }
        )
        mediapipe.append({"landmarks": [[*row, 0.9] for row in np.round(points, 5).tolist()]})
    read = {}
    for layout, frames in (("smpl24", smpl), ("mediapipe33", mediapipe)):
        path = out / f"keypoints-{layout}.json"
        about = {"format": "metanerf-keypoints", "version": 1, "layout": layout}
        path.write_text(json.dumps(about | {"frames_per_second": 10, "frames": frames}) + "\n")
        read[layout] = described(read_keypoints(path))
    return read


def make_meeting(work: Path, clip: Sequence, model_file: Path, out: Path) -> dict:
    """A server's folder: Ada hosts and stands in the room, Bo waits, and it was recorded."""
    services = build_services(
        load_settings(data_dir=work / "data", jwt_secret="of a test, long enough to sign with"),
        clock=lambda: NOW,
    )
    services.database.migrate()
    model = import_model(services, model_file, "house", "Ada")
    motion = clip.test[NOVEL_VIEW].motion
    stored = services.objects.put(model.person_id, [motion_bytes(motion)])
    sequence = SequenceRow(
        id=new_id(),
        person_id=model.person_id,
        kind=SequenceKind.KEYPOINTS,
        state=SequenceState.READY,
        created_at=NOW,
        source_name="motion.json",
        source_sha256=stored.sha256,
    )
    with services.unit_of_work() as unit:
        unit.sequences.add(sequence)
        unit.flush()
        unit.motions.add(
            MotionRow(
                person_id=model.person_id,
                sequence_id=sequence.id,
                frames=len(motion),
                duration_s=motion.duration_s,
                sha256=stored.sha256,
            )
        )
        meeting = create_meeting(services, unit, "house", "Monday", [model], lobby=True)
        ada, _ = take_seat(services, unit, meeting, Principal("house", ALL_SCOPES), "Ada")
        unit.flush()
        ada.role, ada.heard_at = Role.HOST, NOW
        bo, _ = take_seat(services, unit, meeting, Principal("neighbours", ALL_SCOPES), "Bo")
        bo.heard_at = NOW
        consent.ask(unit, meeting, ada, meeting.performers[0].id, NOW)
        unit.commit()
    recording_id = asyncio.run(record(services, meeting.id, ada, clip.motion))
    recorded = load(services, recording_id)
    ((performer_id, (times, _)),) = recorded.motions.items()
    at_s = times[len(times) // 2] / 1000.0
    (stood,) = recorded.scene_at(at_s).performers
    services.close()
    zip_folder(work / "data", out / "meeting.zip")
    return {
        "meeting_id": meeting.id,
        "person_id": model.person_id,
        "model_id": model.id,
        "sequence_id": sequence.id,
        "recording_id": recording_id,
        "participants": {one.id: [one.display_name, one.role, one.standing] for one in (ada, bo)},
        "motion": described(motion),
        "duration_s": recorded.duration_s,
        "rooms": recorded.rooms,
        "motion_times_ms": {performer_id: times},
        "voices": {
            who: [[one.at_ms, one.data.hex()] for one in said]
            for who, said in recorded.voices.items()
        },
        "at_s": at_s,
        "pose": {
            "joint_angles": np.round(stood.pose.joint_angles, 6).tolist(),
            "root_translation": np.round(stood.pose.root_translation, 6).tolist(),
            "expression": np.round(stood.pose.expression, 6).tolist(),
        },
    }


async def record(services: Services, meeting_id: str, host: ParticipantRow, motion: Motion) -> str:
    """Half a second of the meeting, with everything that is kept of one; the recording's id."""
    with services.reading() as unit:
        meeting = unit.meetings.get(meeting_id)
        recording = unit.recordings.under_way(meeting_id)
    performer_id = meeting.performers[0].id
    sent = 0

    def poses(meeting_id: str) -> list[tuple[str, bytes]]:
        nonlocal sent
        pose = motion.pose(sent % len(motion))
        sent += 1
        packet = PosePacket(
            sequence=sent,
            capture_time_ms=1000.0 * pose.time_s,
            index=0,
            count=1,
            check=performer_check(performer_id),
            pelvis=np.array([0.1, 0.9, -0.2]) + pose.root_translation,
            turns=matrix_to_quaternion(axis_angle_to_matrix(pose.joint_angles)),
            expression=np.linspace(0.0, 1.0, EXPRESSION_COUNT),
        )
        return [(performer_id, encode_pose(packet))]

    listeners = {}
    recorders = Recorders(services, poses, listeners, time.monotonic)
    present, stands = present_in(meeting, NOW), standing_for(meeting, NOW)
    await recorders.see(meeting, present, stands, recording, [])
    said = MessageRow(
        meeting_id=meeting.id,
        number=1,
        kind=MessageKind.CHAT,
        participant_id=host.id,
        name=host.display_name,
        text="hello",
        at=NOW,
    )
    await recorders.see(meeting, present, stands, recording, [said])
    for number in range(10):
        listeners[meeting.id](host.id, OpusPacket(OPUS_SILENCE, 960 * number, True))
        await asyncio.sleep(0.05)
    await recorders.close()
    with services.unit_of_work() as unit:
        unit.meetings.say(said)
        consent.end(unit.recordings.get_for_change(recording.id), "the host ended it", NOW)
        unit.commit()
    return recording.id


def main(out: Path) -> None:
    """Write everything to `out`."""
    out.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp())
    clip, session = make_session(work, out)
    expected = {
        "sequence": session,
        "splats": make_model(
            clip, SPLATS, out / "splats.safetensors", iterations=ITERATIONS, find_light=True
        ),
        "field": make_model(clip, FIELD, out / "field.safetensors", iterations=40),
        "splats-stopped": make_checkpoint(work, clip, SPLATS, ITERATIONS, out / "splats-stopped"),
        "field-stopped": make_checkpoint(work, clip, FIELD, 40, out / "field-stopped"),
        "keypoints": make_keypoints(clip.motion, out),
        "meeting": make_meeting(work, clip, out / "splats.safetensors", out),
    }
    (out / "expected.json").write_text(json.dumps(expected) + "\n")
    shutil.rmtree(work)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
