"""Keeps what is moved and said in the meetings of this gateway, where everybody agreed to it.

Chunks of a few seconds go to the store as they fill: a gateway that dies loses the last of them,
and the one that people come back to goes on where it ended. A recording is kept by one gateway at a
time; a second that tries finds the chunk written already, and leaves it to the first.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field

from anyio import to_thread

from db.errors import Conflict, DatabaseError, NotFound
from db.models import (
    MeetingRow,
    MessageKind,
    MessageRow,
    ParticipantRow,
    PerformerRow,
    RecordingChunkRow,
    RecordingRow,
    RecordingState,
)
from services.arrangement import view_from_the_front
from services.container import Services
from services.live.sessions.voice_sessions import PacketListener
from services.live.streaming.forwarding import OpusPacket
from services.meetings import placed, position, yaw
from services.recording import consent
from services.recording.chunks import LONGEST_RECORD, Record, pack
from services.recording.voice_times import VoiceTimes

log = logging.getLogger(__name__)

POSES_PER_SECOND = 30
CHUNK_MS = 5000
_VOICE_LATER_MS = 85
"""Motion is kept later than it was made, by what finding it in a picture, sending, solving and
keeping it take; so is the voice that belongs to it (`metanerf bench lipsync`)."""
Poses = Callable[[str], list[tuple[str, bytes]]]
"""Meeting -> pose packets of its performers as they stand now, by performer."""


@dataclass(eq=False)
class _Track:
    person_id: str | None
    account: str
    number: int
    records: list[Record] = field(default_factory=list)


@dataclass(frozen=True)
class _Owner:
    """Whom a participant's or a performer's track belongs to."""

    person_id: str | None
    account: str


@dataclass(eq=False)
class _ActiveRecording:
    """One recording that runs."""

    recording: RecordingRow
    started_s: float
    from_ms: int
    numbers: dict[str, int]
    """Track -> the number of its next chunk."""
    tracks: dict[str, _Track] = field(default_factory=dict)
    owners: dict[str, _Owner] = field(default_factory=dict)
    room: bytes = b""
    chat: int = 0
    """Number of the newest message that was kept."""
    task: asyncio.Task[None] | None = None


class Recorders:
    """All recordings that this process keeps. Every method runs on its event loop."""

    def __init__(
        self,
        services: Services,
        poses: Poses,
        listeners: dict[str, PacketListener],
        clock: Callable[[], float],
    ) -> None:
        self._services, self._poses, self._clock = services, poses, clock
        self._listeners = listeners
        self._active: dict[str, _ActiveRecording] = {}
        """By meeting."""

    def __len__(self) -> int:
        return len(self._active)

    async def update(
        self,
        meeting: MeetingRow,
        present: Mapping[str, ParticipantRow],
        performers_by_participant: Mapping[str, str],
        recording: RecordingRow | None,
        said: list[MessageRow],
    ) -> None:
        """Record, pause or end as the meeting now stands.

        `present` are the participants who are there; `performers_by_participant`
        names the performer that represents each of them, shown or not.
        """
        active = self._active.get(meeting.id)
        if recording is not None and not consent.agreed_in(recording) & set(present):
            await to_thread.run_sync(self._end, recording.id, "everybody left")
            recording = None
        runs = recording is not None and consent.all_agree(recording, present)
        if active is not None and (
            recording is None or not runs or active.recording.id != recording.id
        ):
            await self.pause(meeting.id)
            active = None
        if recording is None or not runs:
            return
        if active is None:
            active = await self._start(meeting.id, recording, said)
        if active is None:
            return
        recordable = consent.recordable(meeting, self._services.clock())
        _update_owners(active, recordable, present, performers_by_participant)
        self._note_room(active, meeting.environment, recordable, performers_by_participant)
        for message in said:
            if message.kind is MessageKind.CHAT and message.number > active.chat:
                active.chat = message.number
                text = message.text.encode()[:LONGEST_RECORD]
                self._add(active, f"chat:{message.participant_id}", message.participant_id, text)

    async def close(self) -> None:
        """Keep what there is, at shutdown; the next gateway goes on."""
        for meeting_id in list(self._active):
            await self.pause(meeting_id)

    async def _start(
        self, meeting_id: str, recording: RecordingRow, said: list[MessageRow]
    ) -> _ActiveRecording | None:
        begun = await to_thread.run_sync(self._begin, recording.id)
        if begun is None:
            return None
        numbers, from_ms = begun
        active = _ActiveRecording(recording, self._clock(), from_ms, numbers)
        # what was said before is nobody's to keep
        active.chat = max((one.number for one in said), default=0)
        self._active[meeting_id] = active

        times: dict[str, VoiceTimes] = {}

        def hear(participant_id: str, packet: OpusPacket) -> None:
            said = times.setdefault(participant_id, VoiceTimes())
            at_ms = said.at_ms(packet.timestamp, self._now_ms(active)) + _VOICE_LATER_MS
            self._add(active, f"voice:{participant_id}", participant_id, packet.payload, at_ms)

        self._listeners[meeting_id] = hear
        name = f"recording {recording.id}"
        active.task = asyncio.create_task(self._run(meeting_id, active), name=name)
        return active

    async def pause(self, meeting_id: str) -> None:
        """Keep what there is of one meeting; whichever gateway records it next goes on."""
        active = self._active.pop(meeting_id, None)
        if active is None:
            return
        self._listeners.pop(meeting_id, None)
        if active.task is not None and active.task is not asyncio.current_task():
            active.task.cancel()
            await asyncio.gather(active.task, return_exceptions=True)
        await self._flush(active)

    async def _run(self, meeting_id: str, active: _ActiveRecording) -> None:
        due_s, flushed_ms = self._clock(), active.from_ms
        while True:
            for performer_id, packet in self._poses(meeting_id):
                self._add(active, f"motion:{performer_id}", performer_id, packet)
            if self._now_ms(active) - flushed_ms >= CHUNK_MS:
                flushed_ms = self._now_ms(active)
                if not await self._flush(active):
                    self._active.pop(meeting_id, None)
                    self._listeners.pop(meeting_id, None)
                    return
            due_s = max(due_s + 1.0 / POSES_PER_SECOND, self._clock())
            await asyncio.sleep(due_s - self._clock())

    def _now_ms(self, active: _ActiveRecording) -> int:
        return active.from_ms + int(1000 * (self._clock() - active.started_s))

    def _add(
        self,
        active: _ActiveRecording,
        name: str,
        who: str,
        data: bytes,
        at_ms: int | None = None,
    ) -> None:
        """Keep `data` of a track, which happened at `at_ms` of the recording; None: now."""
        owner = active.owners.get(who)
        if owner is None:  # not yet, or no longer, in the meeting
            return
        if name not in active.tracks:
            number = active.numbers.get(name, 0)
            active.tracks[name] = _Track(owner.person_id, owner.account, number)
        active.tracks[name].records.append(
            Record(self._now_ms(active) if at_ms is None else at_ms, data)
        )

    def _note_room(
        self,
        active: _ActiveRecording,
        environment: str,
        recordable: list[PerformerRow],
        performers_by_participant: Mapping[str, str],
    ) -> None:
        ids = {one.id for one in recordable}
        performers = [
            {
                "id": one.id,
                "model_id": one.model_id,
                "position": position(one),
                "yaw_rad": yaw(one),
            }
            for one in recordable
        ]
        room = {
            "environment": environment,
            "performers": performers,
            "viewpoint": asdict(view_from_the_front([placed(one) for one in recordable])),
            "standing_for": {
                who: one for who, one in performers_by_participant.items() if one in ids
            },
        }
        data = json.dumps(room, sort_keys=True).encode()
        if data != active.room:
            active.room = data
            self._add(active, "room", "room", data)

    async def _flush(self, active: _ActiveRecording) -> bool:
        """Store what has come; False where this recording is not ours to keep (any more)."""
        tracks = {name: track for name, track in active.tracks.items() if track.records}
        active.tracks = {}
        for name, track in tracks.items():
            active.numbers[name] = track.number + 1
        try:
            return await to_thread.run_sync(
                self._store, active.recording.id, tracks, self._now_ms(active)
            )
        except (Conflict, NotFound) as error:
            log.warning("recording %s is not kept here: %s", active.recording.id, error)
            return False
        except DatabaseError as error:
            log.warning("some seconds of recording %s are lost: %s", active.recording.id, error)
            return True

    def _begin(self, recording_id: str) -> tuple[dict[str, int], int] | None:
        with self._services.unit_of_work() as unit:
            recording = unit.recordings.get_for_change(recording_id)
            if recording.state is RecordingState.ENDED:  # while its meeting was looked at
                return None
            recording.state = RecordingState.RUNNING
            chunks = unit.recordings.chunks(recording_id)
            unit.commit()
        return {chunk.track: chunk.number + 1 for chunk in chunks}, recording.duration_ms

    def _end(self, recording_id: str, why: str) -> None:
        with self._services.unit_of_work() as unit:
            consent.end(unit.recordings.get_for_change(recording_id), why, self._services.clock())
            unit.commit()

    def _store(self, recording_id: str, tracks: dict[str, _Track], now_ms: int) -> bool:
        """Bytes first, rows last."""
        settings, rows = self._services.settings, list[RecordingChunkRow]()
        for name, track in tracks.items():
            owner = track.person_id or recording_id
            stored = self._services.objects.put(owner, [pack(track.records)])
            rows.append(
                RecordingChunkRow(
                    recording_id=recording_id,
                    track=name,
                    number=track.number,
                    person_id=track.person_id,
                    account=track.account,
                    owner=owner,
                    bytes=stored.bytes,
                    sha256=stored.sha256,
                )
            )
        with self._services.unit_of_work() as unit:
            recording = unit.recordings.get_for_change(recording_id)
            for row in rows:
                unit.recordings.add_chunk(row)
            recording.duration_ms = max(recording.duration_ms, now_ms)
            recording.bytes += sum(row.bytes for row in rows)
            full = (
                recording.bytes > settings.recording.max_bytes
                or recording.duration_ms > 1000 * settings.recording.max_duration_s
            )
            if full:
                consent.end(recording, "it is as long as it may be", self._services.clock())
            unit.commit()
        return not full


def _update_owners(
    active: _ActiveRecording,
    recordable: list[PerformerRow],
    present: Mapping[str, ParticipantRow],
    performers_by_participant: Mapping[str, str],
) -> None:
    """Note whom each track would belong to: a performer's person, also for whom it represents.

    Whoever is represented by somebody who is not to be recorded has none: nothing is kept of them.
    """
    owners = {one.id: _Owner(one.person_id, one.account) for one in recordable}
    persons = {one.id: one.person_id for one in recordable}
    for who, one in present.items():
        performer = performers_by_participant.get(who)
        if performer is None:
            owners[who] = _Owner(None, one.account)
        elif performer in persons:
            owners[who] = _Owner(persons[performer], one.account)
    owners["room"] = _Owner(None, "")
    active.owners = owners
