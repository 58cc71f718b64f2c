"""A recording read back: its tracks, and how everybody stood at a moment."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from db.models import RecordingChunkRow
from renderer.performer_model import PerformerModel
from scene.environment import Environment, Performer, Scene
from scene.motion import Pose
from scene.rotations import matrix_to_axis_angle, quaternion_to_matrix
from services.container import Services
from services.environments import STUDIO, environment, environment_in, themes
from services.jobs.queue import Orphan, drop_orphans
from services.likeness import shown_chunks
from services.live.packets import PosePacket, decode_pose
from services.recording.chunks import Record, records_of, unpack


def unpacked(services: Services, chunks: Iterable[RecordingChunkRow]) -> Iterator[bytes]:
    """The bytes of a track, chunk by chunk."""
    for chunk in chunks:
        yield unpack(b"".join(services.objects.stream(chunk.owner, chunk.sha256)))


def records(data: Iterable[bytes]) -> Iterator[Record]:
    """The records of a track."""
    for piece in data:
        yield from records_of(piece)


def drop(services: Services, objects: list[Orphan]) -> None:
    """Delete bytes that no row points at any more."""
    drop_orphans(services, objects)


@dataclass(frozen=True, eq=False)
class LoadedRecording:
    """A whole recording in memory, as an export needs it."""

    duration_s: float
    rooms: list[tuple[int, dict]]
    """Moment (ms) and what `services.recording.recorder` noted of the room then."""
    motions: dict[str, tuple[list[int], list[PosePacket]]]
    """Performer -> moments (ms) and poses."""
    voices: dict[str, list[Record]]
    models: dict[str, PerformerModel]
    own_environment: Environment
    """Environment of a meeting that uses none of the library."""
    people: frozenset[str]
    """Ids of the people whose motion, voice or words these are."""

    def scene_at(self, at_s: float) -> Scene[PerformerModel]:
        """Everybody of the room as they stood at a moment, or as they were last seen before it."""
        at_ms = int(1000 * at_s)
        room = self._room(at_ms)
        performers = []
        for one in room.get("performers", []):
            times, packets = self.motions.get(one["id"], ([], []))
            model = self.models.get(one["model_id"])
            if times and model is not None:
                packet = packets[max(0, bisect_right(times, at_ms) - 1)]
                performers.append(_performer(one["id"], model, packet))
        name = room.get("environment", STUDIO)
        return Scene(
            environment(name) if name in themes() else self.own_environment, tuple(performers)
        )

    def _room(self, at_ms: int) -> dict:
        index = bisect_right([at for at, _ in self.rooms], at_ms) - 1
        return self.rooms[max(0, index)][1] if self.rooms else {}


def load(services: Services, recording_id: str) -> LoadedRecording:
    """Read a recording. Raises NotFound; a person who was erased, or does not consent to recordings
    now, is simply not in it."""
    with services.reading() as unit:
        recording = unit.recordings.get(recording_id)
        chunks = shown_chunks(unit, recording_id, services.clock())
        own_environment = environment_in(unit, recording.meeting_id)
    tracks: dict[str, list[RecordingChunkRow]] = {}
    for chunk in chunks:
        tracks.setdefault(chunk.track, []).append(chunk)
    read = {name: list(records(unpacked(services, rows))) for name, rows in tracks.items()}
    rooms = [(one.at_ms, json.loads(one.data)) for one in read.get("room", [])]
    motions, voices = {}, {}
    for name, found in read.items():
        kind, _, who = name.partition(":")
        if kind == "motion":
            motions[who] = [one.at_ms for one in found], [decode_pose(one.data) for one in found]
        elif kind == "voice":
            voices[who] = found
    wanted = {
        one["model_id"] for _, room in rooms for one in room["performers"] if one["id"] in motions
    }
    models = {model_id: services.models.load(model_id) for model_id in wanted}
    return LoadedRecording(
        recording.duration_ms / 1000.0,
        rooms,
        motions,
        voices,
        models,
        own_environment,
        frozenset(chunk.person_id for chunk in chunks if chunk.person_id is not None),
    )


def _performer(name: str, model: PerformerModel, packet: PosePacket) -> Performer[PerformerModel]:
    """A pose packet is of the room: the performer's position and yaw are in it already."""
    angles = matrix_to_axis_angle(quaternion_to_matrix(packet.rotations))
    root = packet.pelvis - model.skeleton.rest_joints[0]
    pose = Pose(angles, root, packet.capture_time_ms / 1e3, packet.expression)
    return Performer(name, model, np.zeros(3), 0.0, pose)
