"""What view sessions need of stored meetings: performers, environment, seats."""

from __future__ import annotations

import logging
from collections.abc import Callable

from anyio import to_thread

from db.errors import DatabaseError
from db.models import Purpose
from scene.environment import Environment
from services import seats
from services.container import Services
from services.environments import environment_in
from services.live.room import MeetingPerformer
from services.meetings import performed_motion, position, yaw

log = logging.getLogger(__name__)


class StoredMeetings:
    """Meetings as rows of the database."""

    def __init__(self, services: Services) -> None:
        self._services = services

    async def performers(self, meeting_id: str) -> tuple[MeetingPerformer, ...]:
        """The performers of a meeting, models loaded. Raises NotFound."""
        return await to_thread.run_sync(load_performers, self._services, meeting_id)

    async def environment(self, meeting_id: str) -> Environment:
        """The environment that a meeting is held in. Raises NotFound."""
        return await to_thread.run_sync(load_environment, self._services, meeting_id)

    async def sealed(self, meeting_id: str) -> bool:
        """Whether motion in a meeting is encrypted. Raises NotFound."""
        return await to_thread.run_sync(_sealed, self._services, meeting_id)

    async def renew_seats(self, participant_ids: set[str]) -> None:
        """Note that these seats are in use."""
        await self._change_seats(seats.renew_seats, participant_ids)

    async def release_seats(self, participant_ids: set[str]) -> None:
        """Note that these seats are free."""
        await self._change_seats(seats.release_seats, participant_ids)

    async def _change_seats(
        self, change: Callable[[Services, set[str]], object], participant_ids: set[str]
    ) -> None:
        try:
            await to_thread.run_sync(change, self._services, participant_ids)
        except DatabaseError as error:
            # views go on without the database: seats that can't be released lapse
            log.warning("seats could not be updated: %s", error)


def load_performers(services: Services, meeting_id: str) -> tuple[MeetingPerformer, ...]:
    """The performers of a meeting who may be shown now, models loaded. Raises NotFound."""
    now = services.clock()
    with services.reading() as unit:
        performers = unit.meetings.get(meeting_id).shown_at(now)
        rows = [unit.models.get(performer.model_id) for performer in performers]
        motions = [performed_motion(services, unit, performer) for performer in performers]
    return tuple(
        MeetingPerformer(
            performer.id,
            performer.name,
            services.models.load_row(row),
            motion,
            position(performer),
            yaw(performer),
            performer.account,
            performer.person.consents_to(Purpose.DRIVING, now),
            performer.person.consents_to(Purpose.LEARNING, now),
        )
        for performer, row, motion in zip(performers, rows, motions, strict=True)
    )


def load_environment(services: Services, meeting_id: str) -> Environment:
    """The environment that a meeting is held in. Raises NotFound."""
    with services.reading() as unit:
        return environment_in(unit, meeting_id)


def _sealed(services: Services, meeting_id: str) -> bool:
    with services.reading() as unit:
        return unit.meetings.get(meeting_id).sealed
