"""What one gateway process holds: its services, and the live sessions of its meetings."""

from __future__ import annotations

import time
from dataclasses import dataclass

from fastapi import FastAPI
from fastapi.concurrency import run_in_threadpool

from services.container import Services
from services.control.hub import Hub
from services.jobs.events import meeting_topic
from services.limits import RateLimit
from services.live.motion.live_looks import LiveLooks
from services.live.sessions.stored_meetings import StoredMeetings
from services.live.sessions.view_sessions import ViewSessions
from services.live.sessions.voice_sessions import VoiceSessions
from services.live.streaming.latency_code import LatencyCode
from services.problems import problem_of
from services.recording.recorder import Recorders

COMMANDS_PER_MINUTE = 120
"""Messages that one participant may send on the control channel."""


@dataclass(frozen=True, eq=False)
class Gateway:
    """Everything that a route may ask for."""

    services: Services
    views: ViewSessions
    voices: VoiceSessions
    looks: LiveLooks
    hub: Hub
    command_limit: RateLimit

    async def show_anew(self, meeting_id: str) -> None:
        """Have a meeting shown as its rows are now: pictures of this process move at once, and the
        hub tells pages and other gateways."""
        await self.views.refresh(meeting_id)
        self.hub.notify(meeting_id)
        await run_in_threadpool(self.services.events.publish, meeting_topic(meeting_id))

    async def close(self) -> None:
        """End every live session, at shutdown. The services stay open."""
        await self.hub.close()
        await self.voices.close_all()
        await self.views.close_all()
        self.looks.close()


def build_gateway(services: Services) -> Gateway:
    """A gateway that serves nobody yet."""
    settings, looks = services.settings, LiveLooks(time.monotonic)
    views = ViewSessions(
        StoredMeetings(services),
        time.monotonic,
        ice_servers=settings.live.ice_servers,
        max_viewers=settings.live.max_viewers,
        describe_error=lambda error: problem_of(error).model_dump_json(),
        instrumentation=LatencyCode() if settings.live.stamp_pictures else None,
        make_look_sink=looks.sink,
    )
    voices = VoiceSessions(
        lambda meeting_id: hub.send_speaking(meeting_id),
        ice_servers=settings.live.ice_servers,
        max_connections=settings.live.max_voices,
    )
    recorders = Recorders(services, views.pose_packets, voices.packet_listeners, time.monotonic)
    hub = Hub(services, views, voices, recorders)
    command_limit = RateLimit("messages of one person", COMMANDS_PER_MINUTE, services.clock)
    return Gateway(services, views, voices, looks, hub, command_limit)


def gateway_of(app: FastAPI) -> Gateway:
    """The gateway that `app` serves (services.app.create_app)."""
    return app.state.gateway
