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
from dataclasses import dataclass, field

from fastapi.concurrency import run_in_threadpool

from db.errors import Conflict, DatabaseError, NotFound
from db.models import (
    MeetingRow,
    MessageKind,
    MessageRow,
    ParticipantRow,
    RecordingChunkRow,
    RecordingRow,
    RecordingState,
)
from services.container import Services
from services.live.sessions.voice_sessions import PacketListener
from services.live.streaming.forwarding import OpusPacket
from services.recording import consent
from services.recording.chunks import LONGEST_RECORD, Record, pack

log = logging.getLogger(__name__)

POSES_PER_SECOND = 30
_CHUNK_MS = 5000
Poses = Callable[[str], list[tuple[str, bytes]]]
"""Meeting -> pose packets of its performers as they stand now, by performer."""


@dataclass(eq=False)
class _Track:
    person_id: str | None
    account: str
    number: int
    records: list[Record] = field(default_factory=list)


@dataclass(frozen=True)
class _Whose:
    """Whose a participant's or a performer's track is."""

    person_id: str | None
    account: str


@dataclass(eq=False)
class _Keeping:
    """One recording that runs."""

    recording: RecordingRow
    started_s: float
    from_ms: int
    numbers: dict[str, int]
    """Track -> the number of its next chunk."""
    tracks: dict[str, _Track] = field(default_factory=dict)
    whose: dict[str, _Whose] = field(default_factory=dict)
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
        self._keeping: dict[str, _Keeping] = {}
        """By meeting."""

    def __len__(self) -> int:
        return len(self._keeping)

    async def see(
        self,
        meeting: MeetingRow,
        present: Mapping[str, ParticipantRow],
        standing_for: Mapping[str, str],
        recording: RecordingRow | None,
        said: list[MessageRow],
    ) -> None:
        """Keep, rest or end as the meeting now stands.

        `present` are the participants who are there; `standing_for` says which performer stands for
        whom.
        """
        keeping = self._keeping.get(meeting.id)
        if recording is not None and not consent.agreed_in(recording) & set(present):
            await run_in_threadpool(self._end, recording.id, "everybody left")
            recording = None
        runs = recording is not None and consent.all_agree(recording, present)
        if keeping is not None and (
            recording is None or not runs or keeping.recording.id != recording.id
        ):
            await self._rest(meeting.id)
            keeping = None
        if recording is None or not runs:
            return
        if keeping is None:
            keeping = await self._start(meeting.id, recording, said)
        if keeping is None:
            return
        _take_stock(keeping, meeting, present, standing_for)
        self._note_room(keeping, meeting, standing_for)
        for message in said:
            if message.kind is MessageKind.CHAT and message.number > keeping.chat:
                keeping.chat = message.number
                text = message.text.encode()[:LONGEST_RECORD]
                self._add(keeping, f"chat:{message.participant_id}", message.participant_id, text)

    async def close(self) -> None:
        """Keep what there is, at shutdown; the next gateway goes on."""
        for meeting_id in list(self._keeping):
            await self._rest(meeting_id)

    async def _start(
        self, meeting_id: str, recording: RecordingRow, said: list[MessageRow]
    ) -> _Keeping | None:
        begun = await run_in_threadpool(self._begin, recording.id)
        if begun is None:
            return None
        numbers, from_ms = begun
        keeping = _Keeping(recording, self._clock(), from_ms, numbers)
        # what was said before is nobody's to keep
        keeping.chat = max((one.number for one in said), default=0)
        self._keeping[meeting_id] = keeping

        def hear(participant_id: str, packet: OpusPacket) -> None:
            self._add(keeping, f"voice:{participant_id}", participant_id, packet.payload)

        self._listeners[meeting_id] = hear
        keeping.task = asyncio.create_task(self._run(meeting_id, keeping))
        return keeping

    async def _rest(self, meeting_id: str) -> None:
        keeping = self._keeping.pop(meeting_id, None)
        if keeping is None:
            return
        self._listeners.pop(meeting_id, None)
        if keeping.task is not None and keeping.task is not asyncio.current_task():
            keeping.task.cancel()
            await asyncio.gather(keeping.task, return_exceptions=True)
        await self._flush(keeping)

    async def _run(self, meeting_id: str, keeping: _Keeping) -> None:
        due_s, flushed_ms = self._clock(), keeping.from_ms
        while True:
            for performer_id, packet in self._poses(meeting_id):
                self._add(keeping, f"motion:{performer_id}", performer_id, packet)
            if self._now_ms(keeping) - flushed_ms >= _CHUNK_MS:
                flushed_ms = self._now_ms(keeping)
                if not await self._flush(keeping):
                    self._keeping.pop(meeting_id, None)
                    self._listeners.pop(meeting_id, None)
                    return
            due_s = max(due_s + 1.0 / POSES_PER_SECOND, self._clock())
            await asyncio.sleep(due_s - self._clock())

    def _now_ms(self, keeping: _Keeping) -> int:
        return keeping.from_ms + int(1000 * (self._clock() - keeping.started_s))

    def _add(self, keeping: _Keeping, name: str, who: str, data: bytes) -> None:
        whose = keeping.whose.get(who)
        if whose is None:  # not yet, or no longer, in the meeting
            return
        if name not in keeping.tracks:
            number = keeping.numbers.get(name, 0)
            keeping.tracks[name] = _Track(whose.person_id, whose.account, number)
        keeping.tracks[name].records.append(Record(self._now_ms(keeping), data))

    def _note_room(
        self, keeping: _Keeping, meeting: MeetingRow, standing_for: Mapping[str, str]
    ) -> None:
        performers = [
            {
                "id": one.id,
                "model_id": one.model_id,
                "position": [one.x_m, one.y_m, one.z_m],
                "yaw_rad": one.yaw_rad,
            }
            for one in meeting.performers
        ]
        room = {
            "environment": meeting.environment,
            "performers": performers,
            "standing_for": dict(standing_for),
        }
        data = json.dumps(room, sort_keys=True).encode()
        if data != keeping.room:
            keeping.room = data
            self._add(keeping, "room", "room", data)

    async def _flush(self, keeping: _Keeping) -> bool:
        """Store what has come; False where this recording is not ours to keep (any more)."""
        tracks = {name: track for name, track in keeping.tracks.items() if track.records}
        keeping.tracks = {}
        for name, track in tracks.items():
            keeping.numbers[name] = track.number + 1
        try:
            return await run_in_threadpool(
                self._store, keeping.recording.id, tracks, self._now_ms(keeping)
            )
        except (Conflict, NotFound) as error:
            log.warning("recording %s is not kept here: %s", keeping.recording.id, error)
            return False
        except DatabaseError as error:
            log.warning("some seconds of recording %s are lost: %s", keeping.recording.id, error)
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
                recording.bytes > settings.max_recording_bytes
                or recording.duration_ms > 1000 * settings.max_recording_s
            )
            if full:
                consent.end(recording, "it is as long as it may be", self._services.clock())
            unit.commit()
        return not full


def _take_stock(
    keeping: _Keeping,
    meeting: MeetingRow,
    present: Mapping[str, ParticipantRow],
    standing_for: Mapping[str, str],
) -> None:
    """Note whose each track would be: performers are persons; who is stood for by one is too."""
    whose = {one.id: _Whose(one.person_id, one.account) for one in meeting.performers}
    persons = {one.id: one.person_id for one in meeting.performers}
    for who, one in present.items():
        performer = standing_for.get(who)
        person_id = persons.get(performer) if performer else None
        whose[who] = _Whose(person_id, one.account)
    whose["room"] = _Whose(None, "")
    keeping.whose = whose
