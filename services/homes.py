"""On which gateway the voices and pictures of a meeting are: its home.

Any gateway answers any call of REST, but voices and motion are forwarded within one process alone,
so that everybody in a meeting has to be on the same. A gateway that browsers reach at an address of
its own (`gateway_url`) says so by a row, a lease that it renews; the meeting's row names its home.
The first who comes has one chosen, of two that are drawn the one with more room (Mitzenmacher
2001), and everybody else is sent there. A home whose lease has run out, or which drains, is none:
the next to ask has another chosen.

All of it is rows, so that it goes on without Redis. Moments are those of the gateways' own clocks,
which must agree within a second. Where no gateway has an address, each serves whoever comes to it.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import timedelta
from random import Random
from urllib.parse import urlsplit

from anyio import to_thread

from db.errors import DatabaseError
from db.models import GatewayRow, MeetingRow, new_id
from db.repositories import UnitOfWork
from services.container import Services
from services.errors import Draining, LivesElsewhere, ServerFull

log = logging.getLogger(__name__)

LEASE_S = 2.5
"""A gateway that was silent for so long is nobody's home; short, for people wait until then."""
RENEW_S = 0.5
_RETURNED = 1
"""Places that a row may have more of with each renewal. Whoever is sent somewhere takes a place of
the row at once, but of the gateway only seconds later: if it said meanwhile that the place is free,
all meetings that begin at one moment would go to one gateway."""
_FORGOTTEN_S = 3600.0
"""After which the row of a gateway that died is deleted."""


@dataclass(frozen=True)
class Home:
    """The gateway that a meeting lives on, as whoever comes to it is told."""

    gateway_id: str | None
    """None: there is no gateway with an address, and whichever is asked serves."""
    url: str
    """Empty for None."""


NOWHERE = Home(None, "")


def least_loaded_of_two(gateways: Sequence[GatewayRow], random: Random) -> GatewayRow:
    """Of two gateways drawn at random, the one with more room; there must be at least one."""
    drawn = random.sample(gateways, min(2, len(gateways)))
    return max(drawn, key=lambda one: one.free)


class Homes:
    """The homes of all meetings, and this gateway's own lease."""

    def __init__(
        self, services: Services, free: Callable[[], int], random: Random | None = None
    ) -> None:
        """`free`: how many more viewers fit here."""
        self._services, self._free, self._random = services, free, random or Random()
        self._url = services.settings.server.gateway_url
        self.id = new_id()
        """Of this process."""
        self.draining = False
        """Whether this process is about to end, and takes nobody more."""
        self._addresses: frozenset[str] = frozenset()
        self._renewing: asyncio.Task[None] | None = None

    def origins(self) -> frozenset[str]:
        """Where pages come from that may be sent here: every gateway's address, and the common."""
        if not self._url:
            return frozenset()
        public = urlsplit(self._services.settings.server.public_url)
        common = {f"{public.scheme}://{public.netloc}"} if public.netloc else set()
        return self._addresses | common

    def start(self) -> None:
        """Hold a lease from now on, where this gateway has an address; on the event loop."""
        if self._url:
            self._renewing = asyncio.create_task(self._renew_again_and_again())

    async def close(self) -> None:
        """Let go of the lease."""
        if self._renewing is None:
            return
        self._renewing.cancel()
        await asyncio.gather(self._renewing, return_exceptions=True)
        try:
            await to_thread.run_sync(self._forget)
        except DatabaseError as error:
            log.warning("the gateway's lease runs out by itself: %s", error)

    def renew(self) -> None:
        """Give a sign of life, and learn which gateways there are."""
        if not self._url:
            return
        now, free = self._services.clock(), max(0, self._free())
        with self._services.unit_of_work() as unit:
            said = unit.gateways.free_places(self.id)
            row = GatewayRow(
                id=self.id,
                url=self._url,
                renewed_at=now,
                free=free if said is None else min(free, said + _RETURNED),
                draining=self.draining,
            )
            unit.gateways.renew(row)
            unit.gateways.forget_silent(now - timedelta(seconds=_FORGOTTEN_S))
            living = unit.gateways.renewed_since(now - timedelta(seconds=LEASE_S))
            unit.commit()
        self._addresses = frozenset(one.url for one in living) | {self._url}

    def find(self, meeting_id: str) -> Home:
        """Where a meeting lives; one that lives nowhere is given a home.

        Raises NotFound, and ServerFull or Draining where no gateway could be its home.
        """
        with self._services.reading() as unit:
            home = self._home_of(unit, unit.meetings.get(meeting_id))
            living = self._living(unit)
        if home is not None or not living:
            return home or self._nowhere()
        with self._services.unit_of_work() as unit:
            home = self.settle(unit, unit.meetings.get_for_change(meeting_id))
            unit.commit()
        return home

    def settle(self, unit: UnitOfWork, meeting: MeetingRow) -> Home:
        """The same of a meeting that is locked for it."""
        home = self._home_of(unit, meeting)
        if home is not None:
            return home
        living = self._living(unit)
        if not living:
            return self._nowhere()
        able = [one for one in living if one.free > 0]
        if not able:
            raise ServerFull(
                f"a meeting must have a gateway with room; got {len(living)} that are full; try "
                "again"
            )
        chosen = least_loaded_of_two(able, self._random)
        meeting.home_id = chosen.id
        unit.gateways.promise(chosen.id)
        return Home(chosen.id, chosen.url)

    def require_here(self, meeting_id: str, path: str) -> None:
        """Raise LivesElsewhere with the address of `path` at the meeting's home, unless that is
        this gateway; as `find`, and Draining while this gateway takes nobody."""
        home = self.find(meeting_id)
        if home.gateway_id not in (None, self.id):
            raise LivesElsewhere(
                f"this must be asked of the gateway that the meeting lives on, {home.url}; got it "
                "at another; go there",
                home.url + path,
            )
        self._require_to_stay()

    def has_moved(self, unit: UnitOfWork, meeting: MeetingRow) -> bool:
        """Whether the people of a meeting who are here have to go to its home. One whose home has
        died may stay where it is."""
        elsewhere = meeting.home_id not in (None, self.id)
        return elsewhere and self._home_of(unit, meeting) is not None

    def _nowhere(self) -> Home:
        """There is no gateway with an address: whoever comes here stays. Raises Draining."""
        self._require_to_stay()
        return NOWHERE

    def _require_to_stay(self) -> None:
        if self.draining:
            raise Draining("a gateway must go on to be joined; got one that ends; ask again", 1)

    def _home_of(self, unit: UnitOfWork, meeting: MeetingRow) -> Home | None:
        if meeting.home_id is None:
            return None
        living = (one for one in self._living(unit) if one.id == meeting.home_id)
        home = next(living, None)
        return None if home is None else Home(home.id, home.url)

    def _living(self, unit: UnitOfWork) -> list[GatewayRow]:
        since = self._services.clock() - timedelta(seconds=LEASE_S)
        return [one for one in unit.gateways.renewed_since(since) if not one.draining]

    async def _renew_again_and_again(self) -> None:
        away = False
        while True:
            try:
                await to_thread.run_sync(self.renew)
                away = False
            except DatabaseError as error:
                if not away:
                    log.warning("the gateway's lease could not be renewed: %s", error)
                away = True
            await asyncio.sleep(RENEW_S)

    def _forget(self) -> None:
        with self._services.unit_of_work() as unit:
            unit.gateways.forget(self.id)
            unit.commit()
