"""Keeps every page of this process told of its meeting: looks at the rows, pushes what is new.

Rows hold the state, so that all gateways tell the same. A wish that is granted here is looked at
once; one that another gateway granted comes as a wake-up (services.jobs.events), or is found by
looking. Each page has an outbox of its own: one who reads slowly holds nobody else up.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from datetime import datetime, timedelta

from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel

from db.errors import DatabaseError
from db.models import Admission, MeetingRow, MessageKind, MessageRow, RecordingRow
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
    is_there,
    present_in,
    presenter_of,
    roster_for,
    standing_for,
)
from services.jobs.events import meeting_topic
from services.live.sessions.view_sessions import ViewSessions
from services.live.sessions.voice_sessions import VoiceSessions
from services.recording.recorder import Recorders

log = logging.getLogger(__name__)

_BEAT_S = 1.0
_LOOK_S = 1.0
"""Between two looks at a meeting in which nothing happens."""
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
class Line:
    """One page's channel, as the hub sees it."""

    meeting_id: str
    participant_id: str
    heard_at: datetime
    number: int
    """Of the newest message that was told."""
    outbox: asyncio.Queue[BaseModel | None] = field(
        default_factory=lambda: asyncio.Queue(_OUTBOX + 2)
    )
    """What is to be sent; None ends the channel."""
    admitted: bool = False
    leaving: bool = False
    ended: bool = False
    told: Roster | None = None
    told_speaking: Speaking | None = None
    noted_at: datetime | None = None

    def tell(self, message: BaseModel) -> None:
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
    ) -> None:
        self._services, self._views, self._voices = services, views, voices
        self._recorders = recorders
        self._lines: dict[str, set[Line]] = {}
        """By meeting."""
        self._shown: dict[str, object] = {}
        """By meeting: the place and the cast that its pictures show."""
        self._watches: dict[str, tuple[asyncio.Task[None], asyncio.Event]] = {}

    def __len__(self) -> int:
        return sum(len(lines) for lines in self._lines.values())

    @asynccontextmanager
    async def attached(self, line: Line) -> AsyncIterator[None]:
        """Keep `line` told; the page that had the same seat before is cut off."""
        lines = self._lines.setdefault(line.meeting_id, set())
        for other in lines:
            if other.participant_id == line.participant_id:
                other.end("replaced")
        lines.add(line)
        self.notify(line.meeting_id)
        try:
            yield
        finally:
            lines.discard(line)
            if not lines and self._lines.get(line.meeting_id) is lines:
                del self._lines[line.meeting_id]

    def notify(self, meeting_id: str) -> None:
        """Look at a meeting now, and go on as long as this process serves anybody in it."""
        if meeting_id not in self._watches:
            stirred = asyncio.Event()
            task = asyncio.create_task(self._watch(meeting_id, stirred))
            self._watches[meeting_id] = (task, stirred)
        self._watches[meeting_id][1].set()

    async def close(self) -> None:
        """End everything, at shutdown; pages come back to the next process."""
        tasks = [task for task, _ in self._watches.values()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await self._recorders.close()

    def tell_speaking(self, meeting_id: str) -> None:
        """Tell everybody who was let in who speaks now, and in which track."""
        who, slots = self._voices.speakers_in(meeting_id)
        speaking = Speaking(participant_ids=sorted(who), slots=list(slots))
        for line in self._lines.get(meeting_id, ()):
            if line.admitted and line.told_speaking != speaking:
                line.told_speaking = speaking
                line.tell(speaking)

    def _serves(self, meeting_id: str) -> bool:
        return (
            meeting_id in self._lines
            or self._views.is_watched(meeting_id)
            or self._voices.is_active(meeting_id)
        )

    async def _watch(self, meeting_id: str, stirred: asyncio.Event) -> None:
        async with self._services.events.listen(meeting_topic(meeting_id)) as listener:

            async def relay() -> None:
                while True:
                    await listener.wait(_LOOK_S)
                    stirred.set()

            relaying = asyncio.create_task(relay())
            try:
                while self._serves(meeting_id):
                    await stirred.wait()
                    stirred.clear()
                    await self._look_calmly(meeting_id)
            finally:
                # from here on the next to come starts a watch of their own
                del self._watches[meeting_id]
                self._shown.pop(meeting_id, None)
                relaying.cancel()
                await asyncio.gather(relaying, return_exceptions=True)

    async def _look_calmly(self, meeting_id: str) -> None:
        try:
            await self._look(meeting_id)
        except DatabaseError as error:
            # live meetings go on without it; what is new is told when it is back
            log.warning("meeting %s could not be looked at: %s", meeting_id, error)
            await asyncio.sleep(_LOOK_S)
        except Exception:
            log.exception("looking at meeting %s failed", meeting_id)
            await asyncio.sleep(_LOOK_S)

    async def _look(self, meeting_id: str) -> None:
        lines = [line for line in self._lines.get(meeting_id, ()) if not line.ended]
        now = self._services.clock()
        for line in lines:
            if now - line.heard_at > timedelta(seconds=SILENCE_S):
                line.end("silent")
        lines = [line for line in lines if not line.ended and not line.leaving]
        moments = {line.participant_id: line.heard_at for line in lines if _to_note(line)}
        newest = min((line.number for line in lines), default=None)
        meeting, said, recording = await run_in_threadpool(
            _read, self._services, meeting_id, moments, newest
        )
        for line in lines:
            if line.leaving:
                continue
            line.noted_at = moments.get(line.participant_id, line.noted_at)
            _tell(line, meeting, said, recording, self._services.clock())
        # whoever has just been let in hears what the others were told
        self.tell_speaking(meeting_id)
        seats = {one.id: one.admission for one in meeting.participants}

        def may_look(participant_id: str | None) -> bool:
            if participant_id is None:
                return not meeting.lobby and meeting.ended_at is None
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
        await self._show(meeting)
        present = present_in(meeting, now)
        await self._recorders.see(meeting, present, standing_for(meeting, now), recording, said)

    async def _show(self, meeting: MeetingRow) -> None:
        """Have pictures follow what was changed, maybe on another gateway."""
        performers = [(one.id, one.model_id, one.motion_sequence_id) for one in meeting.performers]
        shown = (meeting.environment, performers)
        if self._shown.setdefault(meeting.id, shown) != shown:
            self._shown[meeting.id] = shown
            await self._views.refresh(meeting.id)


def _to_note(line: Line) -> bool:
    return line.noted_at is None or line.heard_at - line.noted_at >= timedelta(seconds=_BEAT_S)


def _read(
    services: Services, meeting_id: str, moments: dict[str, datetime], newest: int | None
) -> tuple[MeetingRow, list[MessageRow], RecordingRow | None]:
    """The meeting, what was said after `newest`, what is recorded; notes signs of life."""
    with services.unit_of_work() if moments else services.reading() as unit:
        if moments:
            unit.meetings.heard(moments)
        meeting = unit.meetings.get(meeting_id)
        said = [] if newest is None else unit.meetings.said_since(meeting_id, newest)
        recording = unit.recordings.under_way(meeting_id)
        if moments:
            unit.commit()
    return meeting, said, recording


def _tell(
    line: Line,
    meeting: MeetingRow,
    said: list[MessageRow],
    recording: RecordingRow | None,
    now: datetime,
) -> None:
    me = next((one for one in meeting.participants if one.id == line.participant_id), None)
    if me is None or not is_there(me, now):
        line.end("given-back")
        return
    if reason := _ENDS.get(me.admission):
        line.end(reason)
        return
    roster = roster_for(meeting, me.id, now, recording)
    if roster != line.told:
        line.told = roster
        line.tell(roster)
    line.admitted = me.admission is Admission.ADMITTED
    if not line.admitted:
        return
    for message in said:
        if message.number > line.number:
            line.number = message.number
            _tell_message(line, message, now)


def _tell_message(line: Line, message: MessageRow, now: datetime) -> None:
    about = {
        "number": message.number,
        "participant_id": message.participant_id,
        "name": message.name,
    }
    if message.kind is MessageKind.CHAT:
        line.tell(Said(**about, text=message.text, at=message.at))
    elif now - message.at > timedelta(seconds=_STALE_S):
        return
    elif message.kind is MessageKind.CAPTION:
        line.tell(Captioned(**about, text=message.text))
    else:
        line.tell(Reacted.model_validate(about | {"reaction": message.text}))
