"""What one gateway process holds: its services, and the live sessions of its meetings."""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import dataclass

from fastapi import FastAPI
from fastapi.concurrency import run_in_threadpool

from db.errors import DatabaseError
from services.composition import open_renderers
from services.container import Services
from services.control.hub import Hub
from services.forgetting import Forgetting
from services.homes import Homes
from services.jobs.events import meeting_topic
from services.limits import AtOnce, RateLimit
from services.live.motion.live_looks import LiveLooks
from services.live.sessions.stored_meetings import StoredMeetings
from services.live.sessions.view_sessions import ViewSessions
from services.live.sessions.voice_sessions import VoiceSessions
from services.live.streaming.instrumentation import Instrumentation
from services.live.streaming.latency_code import LatencyCode
from services.live.streaming.traced_pictures import TracedPictures
from services.problems import problem_of
from services.recording.recorder import Recorders
from services.refusals import Refusals
from services.uploads.turns import Turns

log = logging.getLogger(__name__)

_LOOK_S = 0.1
COMMANDS_PER_MINUTE = 120
"""Messages that one participant may send on the control channel."""
FOLLOWED_AT_ONCE = 50
"""Jobs that one account may follow: each holds a connection, and one to Redis."""


@dataclass(frozen=True, eq=False)
class Gateway:
    """Everything that a route may ask for."""

    services: Services
    views: ViewSessions
    voices: VoiceSessions
    looks: LiveLooks
    hub: Hub
    homes: Homes
    command_limit: RateLimit
    refusals: Refusals
    followers: AtOnce
    turns: Turns
    forgetting: Forgetting

    async def show_anew(self, meeting_id: str) -> None:
        """Have a meeting shown as its rows are now: pictures of this process move at once, and the
        hub tells pages and other gateways."""
        await self.views.refresh(meeting_id)
        self.hub.notify(meeting_id)
        await run_in_threadpool(self.services.events.publish, meeting_topic(meeting_id))

    def begin(self) -> None:
        """Serve from now on; on the event loop."""
        self.views.warm_up()
        self.homes.start()
        self.forgetting.start()

    async def drain(self, within_s: float) -> None:
        """Have everybody go elsewhere; returns once nobody is here, or after `within_s`."""
        give_up_s = time.monotonic() + within_s
        self.homes.draining = True
        try:
            await run_in_threadpool(self.homes.renew)
        except DatabaseError as error:
            log.warning("other gateways hear late that this one ends: %s", error)
        self.hub.notify_all()
        while time.monotonic() < give_up_s and self._is_in_use():
            await asyncio.sleep(_LOOK_S)

    def _is_in_use(self) -> bool:
        return any(len(one) > 0 for one in (self.hub, self.views, self.voices))

    async def close(self) -> None:
        """End every live session, at shutdown. The services stay open."""
        await self.forgetting.close()
        await self.homes.close()
        await self.hub.close()
        await self.voices.close_all()
        await self.views.close_all()
        self.looks.close()
        await self.refusals.close()


def build_gateway(services: Services) -> Gateway:
    """A gateway that serves nobody yet."""
    settings, looks = services.settings, LiveLooks(time.monotonic)
    refusals = Refusals(services)
    views = ViewSessions(
        StoredMeetings(services),
        time.monotonic,
        open_renderers(settings, time.monotonic),
        ice_servers=settings.live.ice_servers,
        max_viewers=settings.live.max_viewers,
        describe_error=lambda error: problem_of(error).model_dump_json(),
        instrumentation=_instrumentation(services),
        make_look_sink=looks.sink,
        on_refusal=refusals.note_soon,
    )
    voices = VoiceSessions(
        lambda meeting_id: hub.send_speaking(meeting_id),
        ice_servers=settings.live.ice_servers,
        max_connections=settings.live.max_voices,
    )
    recorders = Recorders(services, views.pose_packets, voices.packet_listeners, time.monotonic)
    homes = Homes(services, lambda: settings.live.max_viewers - len(views))
    hub = Hub(services, views, voices, recorders, homes)
    command_limit = RateLimit("messages of one person", COMMANDS_PER_MINUTE, services.clock)
    followers = AtOnce("jobs that one account follows", FOLLOWED_AT_ONCE)
    return Gateway(
        services,
        views,
        voices,
        looks,
        hub,
        homes,
        command_limit,
        refusals,
        followers,
        Turns(),
        Forgetting(services.models),
    )


def _instrumentation(services: Services) -> Instrumentation:
    made = LatencyCode() if services.settings.live.stamp_pictures else Instrumentation()
    tracing = services.tracing
    return TracedPictures(tracing, made, time.monotonic) if tracing.on else made


def gateway_of(app: FastAPI) -> Gateway:
    """The gateway that `app` serves (services.app.create_app)."""
    return app.state.gateway
