"""Keeps every page of this process up to date: polls the rows of its meeting, sends what is new.

Rows hold the state, so that all gateways send the same. A command that is executed here is polled
for at once; one that another gateway executed comes as a notification (services.jobs.events), or
with the next poll. Each page has an outbox of its own: one who reads slowly holds nobody else up.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from datetime import datetime, timedelta

from anyio import to_thread
from pydantic import BaseModel

from db.errors import DatabaseError
from db.models import Admission, MeetingRow, MessageKind, MessageRow, Purpose, RecordingRow
from services.container import Services
from services.control.messages import (
    Captioned,
    Goodbye,
    Reacted,
    Reason,
    Roster,
    Said,
    Speaking,
)
from services.control.roster import (
    SILENCE_S,
    is_attending,
    performers_by_participant,
    present_in,
    presenter_of,
    roster_for,
)
from services.homes import Homes
from services.jobs.events import meeting_topic
from services.live.sessions.view_sessions import ViewSessions
from services.live.sessions.voice_sessions import VoiceSessions
from services.logs import meeting_digest
from services.recording.recorder import Recorders
from services.seats import admits_without_seat

log = logging.getLogger(__name__)

_BEAT_S = 1.0
_POLL_INTERVAL_S = 1.0
"""Between two polls of a meeting in which nothing happens."""
_STALE_S = 10.0
"""Reactions and captions older than that are no news."""
_OUTBOX = 400
"""Messages that may wait for one page; whose are more is cut off, and comes back for the rest."""
_ENDS: Mapping[Admission, Reason] = {
    Admission.DENIED: "denied",
    Admission.REMOVED: "removed",
    Admission.ENDED: "ended",
}


@dataclass(eq=False)
class ControlConnection:
    """One page's channel, as the hub sees it."""

    meeting_id: str
    participant_id: str
    account: str
    heard_at: datetime
    number: int
    """Of the newest message that was sent."""
    outbox: asyncio.Queue[BaseModel | None] = field(
        default_factory=lambda: asyncio.Queue(_OUTBOX + 2)
    )
    """What is to be sent; None ends the channel."""
    admitted: bool = False
    leaving: bool = False
    ended: bool = False
    sent_roster: Roster | None = None
    sent_speaking: Speaking | None = None
    heartbeat_stored_at: datetime | None = None

    def send(self, message: BaseModel) -> None:
        """Have `message` sent, unless the channel is ending."""
        if self.ended:
            return
        if self.outbox.qsize() >= _OUTBOX:
            self.end("silent")
            return
        self.outbox.put_nowait(message)

    def end(self, reason: Reason) -> None:
        """Have the channel ended with a goodbye."""
        if not self.ended:
            self.ended = True
            self.outbox.put_nowait(Goodbye(reason=reason))
            self.outbox.put_nowait(None)


class Hub:
    """All channels of this process. Every method runs on its event loop."""

    def __init__(
        self,
        services: Services,
        views: ViewSessions,
        voices: VoiceSessions,
        recorders: Recorders,
        homes: Homes,
    ) -> None:
        self._services, self._views, self._voices = services, views, voices
        self._homes = homes
        self.recorders = recorders
        """Of this process; who takes their place goes on with what they kept."""
        self._connections: dict[str, set[ControlConnection]] = {}
        """By meeting."""
        self._shown: dict[str, object] = {}
        """By meeting: the environment and the performers that its pictures show."""
        self._watches: dict[str, tuple[asyncio.Task[None], asyncio.Event]] = {}

    def __len__(self) -> int:
        return sum(len(connections) for connections in self._connections.values())

    @asynccontextmanager
    async def attached(self, connection: ControlConnection) -> AsyncIterator[None]:
        """Keep `connection` up to date; the page that had the same seat before is cut off."""
        connections = self._connections.setdefault(connection.meeting_id, set())
        for other in connections:
            if other.participant_id == connection.participant_id:
                other.end("replaced")
        connections.add(connection)
        self.notify(connection.meeting_id)
        try:
            yield
        finally:
            connections.discard(connection)
            if not connections and self._connections.get(connection.meeting_id) is connections:
                del self._connections[connection.meeting_id]

    def notify(self, meeting_id: str, *, room_is_new: bool = False) -> None:
        """Poll a meeting now, and go on as long as this process serves anybody in it.

        A room that is new may have been read from rows that changed since: it is read again.
        """
        if room_is_new:
            self._shown.pop(meeting_id, None)
        if meeting_id not in self._watches:
            notified = asyncio.Event()
            task = asyncio.create_task(self._watch(meeting_id, notified))
            self._watches[meeting_id] = (task, notified)
        self._watches[meeting_id][1].set()

    def notify_all(self) -> None:
        """Poll every meeting now that this process serves anybody in."""
        for meeting_id in list(self._watches):
            self.notify(meeting_id)

    async def close(self) -> None:
        """End everything, at shutdown; pages come back to the next process."""
        tasks = [task for task, _ in self._watches.values()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await self.recorders.close()

    def send_speaking(self, meeting_id: str) -> None:
        """Send everybody who was let in who speaks now, and in which track."""
        who, slots = self._voices.speakers_in(meeting_id)
        speaking = Speaking(participant_ids=sorted(who), slots=list(slots))
        for connection in self._connections.get(meeting_id, ()):
            if connection.admitted and connection.sent_speaking != speaking:
                connection.sent_speaking = speaking
                connection.send(speaking)

    def _serves(self, meeting_id: str) -> bool:
        return (
            meeting_id in self._connections
            or self._views.is_watched(meeting_id)
            or self._voices.is_active(meeting_id)
        )

    async def _watch(self, meeting_id: str, notified: asyncio.Event) -> None:
        async with self._services.events.listen(meeting_topic(meeting_id)) as listener:

            async def relay() -> None:
                while True:
                    await listener.wait(_POLL_INTERVAL_S)
                    notified.set()

            relaying = asyncio.create_task(relay())
            try:
                while self._serves(meeting_id):
                    await notified.wait()
                    notified.clear()
                    await self._poll(meeting_id)
            finally:
                # from here on the next to come starts a watch of their own
                del self._watches[meeting_id]
                self._shown.pop(meeting_id, None)
                relaying.cancel()
                await asyncio.gather(relaying, return_exceptions=True)

    async def _poll(self, meeting_id: str) -> None:
        try:
            await self._synchronise(meeting_id)
        except DatabaseError as error:
            # live meetings go on without it; what is new is sent when it is back
            log.warning("meeting %s could not be polled: %s", meeting_digest(meeting_id), error)
            await asyncio.sleep(_POLL_INTERVAL_S)
        except Exception:
            log.exception("polling meeting %s failed", meeting_digest(meeting_id))
            await asyncio.sleep(_POLL_INTERVAL_S)

    async def _synchronise(self, meeting_id: str) -> None:
        if self._homes.draining:
            await self._send_away(meeting_id)
            return
        connections = [
            connection
            for connection in self._connections.get(meeting_id, ())
            if not connection.ended
        ]
        now = self._services.clock()
        for connection in connections:
            if now - connection.heard_at > timedelta(seconds=SILENCE_S):
                connection.end("silent")
        connections = [
            connection
            for connection in connections
            if not connection.ended and not connection.leaving
        ]
        moments = {
            connection.participant_id: connection.heard_at
            for connection in connections
            if _heartbeat_due(connection)
        }
        newest = min((connection.number for connection in connections), default=None)
        meeting, said, recording, has_moved = await to_thread.run_sync(
            self._read, meeting_id, moments, newest
        )
        if has_moved:
            await self._send_away(meeting_id)
            return
        for connection in connections:
            if connection.leaving:
                continue
            connection.heartbeat_stored_at = moments.get(
                connection.participant_id, connection.heartbeat_stored_at
            )
            _send_updates(connection, meeting, said, recording, self._services.clock())
        # whoever has just been let in gets what the others were sent
        self.send_speaking(meeting_id)
        seats = {one.id: one.admission for one in meeting.participants}

        def may_look(participant_id: str | None) -> bool:
            if participant_id is None:
                return admits_without_seat(meeting)
            return seats.get(participant_id) is Admission.ADMITTED

        await self._views.close_unless(meeting_id, may_look)
        admitted = {one for one, admission in seats.items() if admission is Admission.ADMITTED}
        speakers = {one.id for one in meeting.participants if one.microphone}
        await self._voices.set_permissions(
            meeting_id,
            listeners=admitted,
            speakers=speakers,
            presenter=presenter_of(meeting, now),
        )
        await self._show(meeting, now)
        present = present_in(meeting, now)
        await self.recorders.update(
            meeting, present, performers_by_participant(meeting, now), recording, said
        )

    async def _send_away(self, meeting_id: str) -> None:
        """End all that people of a meeting have here; they go on at its home."""
        for connection in self._connections.get(meeting_id, ()):
            connection.end("moved")
        await self._views.send_away(meeting_id)
        await self._voices.set_permissions(
            meeting_id, listeners=set(), speakers=set(), presenter=None
        )
        await self.recorders.pause(meeting_id)

    def _read(
        self, meeting_id: str, moments: dict[str, datetime], newest: int | None
    ) -> tuple[MeetingRow, list[MessageRow], RecordingRow | None, bool]:
        """The meeting, what was said after `newest`, what is recorded, and whether it lives
        elsewhere; stores heartbeats."""
        with self._services.unit_of_work() if moments else self._services.reading() as unit:
            if moments:
                unit.meetings.heard(moments)
            meeting = unit.meetings.get(meeting_id)
            said = [] if newest is None else unit.meetings.messages_after(meeting_id, newest)
            recording = unit.recordings.under_way(meeting_id)
            has_moved = self._homes.has_moved(unit, meeting)
            if moments:
                unit.commit()
        return meeting, said, recording, has_moved

    async def _show(self, meeting: MeetingRow, now: datetime) -> None:
        """Have pictures follow what was changed, maybe on another gateway or by the time alone."""
        performers = []
        for one in meeting.shown_at(now):
            lent = one.person.consents_to(Purpose.DRIVING, now)
            performers.append((one.id, one.model_id, one.motion_sequence_id, lent))
        shown = (meeting.environment, performers)
        if self._shown.get(meeting.id) != shown:
            self._shown[meeting.id] = shown
            await self._views.refresh(meeting.id)


def _heartbeat_due(connection: ControlConnection) -> bool:
    return (
        connection.heartbeat_stored_at is None
        or connection.heard_at - connection.heartbeat_stored_at >= timedelta(seconds=_BEAT_S)
    )


def _send_updates(
    connection: ControlConnection,
    meeting: MeetingRow,
    said: list[MessageRow],
    recording: RecordingRow | None,
    now: datetime,
) -> None:
    me = next((one for one in meeting.participants if one.id == connection.participant_id), None)
    if me is None or not is_attending(me, now):
        connection.end("given-back")
        return
    if reason := _ENDS.get(me.admission):
        connection.end(reason)
        return
    roster = roster_for(meeting, me.id, now, recording)
    if roster != connection.sent_roster:
        connection.sent_roster = roster
        connection.send(roster)
    connection.admitted = me.admission is Admission.ADMITTED
    if not connection.admitted:
        return
    for message in said:
        if message.number > connection.number:
            connection.number = message.number
            _send_message(connection, message, now)


def _send_message(connection: ControlConnection, message: MessageRow, now: datetime) -> None:
    about = {
        "number": message.number,
        "participant_id": message.participant_id,
        "name": message.name,
    }
    if message.kind is MessageKind.CHAT:
        connection.send(Said(**about, text=message.text, at=message.at))
    elif now - message.at > timedelta(seconds=_STALE_S):
        return
    elif message.kind is MessageKind.CAPTION:
        connection.send(Captioned(**about, text=message.text))
    else:
        connection.send(Reacted.model_validate(about | {"reaction": message.text}))
