"""What services ask of the database about meetings: recordings and gateways of them too.

The rules of `db.repositories` hold here too.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from datetime import datetime
from typing import Protocol

from db.models import (
    GatewayRow,
    MeetingRow,
    MessageKind,
    MessageRow,
    PanoramaRow,
    PersonRow,
    RecordingChunkRow,
    RecordingExportRow,
    RecordingRow,
)


class Meetings(Protocol):
    """Meetings with their performers and participants."""

    def add(self, meeting: MeetingRow) -> None:
        """Store a new meeting, as the transaction commits."""
        ...

    def get(self, meeting_id: str) -> MeetingRow:
        """The meeting of that id. Raises NotFound."""
        ...

    def get_for_change(self, meeting_id: str) -> MeetingRow:
        """The same, locked, so that two who join don't get one seat. Raises NotFound."""
        ...

    def with_label(self, label: str) -> MeetingRow | None:
        """The meeting that is found by that name, such as the demo's; None where there is none."""
        ...

    def moved_by(self, sequence_id: str) -> list[str]:
        """Ids of the meetings in which somebody moves by the motion of a sequence."""
        ...

    def where_performs(self, person_id: str) -> list[str]:
        """Ids of the meetings in which a person stands, or moves somebody else."""
        ...

    def seen(self, participant_ids: Collection[str], now: datetime) -> set[str]:
        """Note a sign of life of participants at `now`; the ids of those who are still there."""
        ...

    def heard(self, moments: Mapping[str, datetime]) -> None:
        """Note when pages of participants last spoke, by the participant's id."""
        ...

    def drop_participants(
        self, participant_ids: Collection[str], *, unless_heard_since: datetime | None = None
    ) -> None:
        """Give seats back, save those whose page has spoken since; gone already is no error."""
        ...

    def panorama(self, meeting_id: str) -> PanoramaRow | None:
        """The place that the host brought along, without its picture; None where there is none."""
        ...

    def panorama_picture(self, meeting_id: str) -> bytes | None:
        """The picture of that place, as equirectangular JPEG; None where there is none."""
        ...

    def set_panorama(self, panorama: PanoramaRow) -> None:
        """Store a meeting's place, instead of the one that it had."""
        ...

    def say(self, message: MessageRow) -> None:
        """Add a message to a meeting that is locked, and number it, from 1."""
        ...

    def messages_after(self, meeting_id: str, number: int) -> list[MessageRow]:
        """The messages after `number`, the oldest first; at most the newest few hundred."""
        ...

    def forget_said(self, meeting_id: str, kind: MessageKind, before: datetime) -> None:
        """Delete the messages of one kind that are older than `before`."""
        ...


class Gateways(Protocol):
    """Gateways that have an address of their own."""

    def renew(self, gateway: GatewayRow) -> None:
        """Store a gateway's sign of life, its first one too, as the transaction commits."""
        ...

    def promise(self, gateway_id: str) -> None:
        """Count one more place of a gateway as taken, by somebody who is on the way to it."""
        ...

    def free_places(self, gateway_id: str) -> int | None:
        """How many places a gateway's row says are free; None: it has none yet."""
        ...

    def renewed_since(self, moment: datetime) -> list[GatewayRow]:
        """The gateways that gave a sign of life since `moment`, by id."""
        ...

    def forget(self, gateway_id: str) -> None:
        """Delete the row of a gateway that ends."""
        ...

    def forget_silent(self, since: datetime) -> None:
        """Delete the rows of gateways that gave no sign of life since then."""
        ...


class Recordings(Protocol):
    """Recordings of meetings."""

    def add(self, recording: RecordingRow) -> None:
        """Store a new recording, as the transaction commits."""
        ...

    def get(self, recording_id: str) -> RecordingRow:
        """The recording of that id. Raises NotFound."""
        ...

    def get_for_change(self, recording_id: str) -> RecordingRow:
        """The same, locked until the transaction ends. Raises NotFound."""
        ...

    def of_meeting(self, meeting_id: str) -> list[RecordingRow]:
        """The recordings of a meeting, the newest first."""
        ...

    def of_account(self, account: str) -> list[RecordingRow]:
        """The recordings that somebody asked for, or agreed to; the newest first."""
        ...

    def under_way(self, meeting_id: str) -> RecordingRow | None:
        """The recording of a meeting that has not ended; None where there is none."""
        ...

    def with_person(self, person_id: str) -> list[str]:
        """Ids of the recordings in which a person moves or speaks."""
        ...

    def people(self, recording_id: str) -> list[PersonRow]:
        """The people who move or speak in a recording, in no particular order."""
        ...

    def add_chunk(self, chunk: RecordingChunkRow) -> None:
        """Store what one track holds of some seconds; its bytes are in the store already."""
        ...

    def chunks(self, recording_id: str, track: str | None = None) -> list[RecordingChunkRow]:
        """The chunks of a recording, or of one of its tracks, by track and number."""
        ...

    def drop_chunks(
        self, recording_id: str, account: str, participant_id: str | None = None
    ) -> list[RecordingChunkRow]:
        """Take out what an account's owner moved and said, or of an account of many what one
        participant said; the rows that went."""
        ...

    def add_export(self, export: RecordingExportRow) -> None:
        """Store a video that was made of a recording; its bytes are in the store already."""
        ...

    def exports(self, recording_ids: Collection[str]) -> list[RecordingExportRow]:
        """The videos that were made of recordings, in no particular order."""
        ...

    def drop_exports(self, recording_ids: Collection[str]) -> list[RecordingExportRow]:
        """Delete videos that were made; the rows that went, whose objects stay."""
        ...

    def ended_before(self, moment: datetime) -> list[RecordingRow]:
        """The recordings that ended before a moment, the oldest first."""
        ...

    def remove(self, recording: RecordingRow) -> list[tuple[str, str]]:
        """Delete a recording's row, and the rows that hang on it with those of its videos; owners
        and hashes of the objects that they named, which stay."""
        ...
