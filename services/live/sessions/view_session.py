"""One viewer's WebRTC connection, and what goes over it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from aiortc import RTCDataChannel, RTCPeerConnection

from services.live.look.receiver import LookReceiver
from services.live.motion.driving_channels import KEYPOINTS, MOTION
from services.live.streaming.view_track import ViewTrack

SILENCE_S = 5.0
"""A viewer silent for so long after their first viewpoint has left (ICE consent needs 30 s)."""
CONNECT_S = 15.0
"""From the answer to a connection; a client that needs longer has left or can't get through."""


class ViewChannel(StrEnum):
    """Labels of the data channels that a viewer may open; others are ignored."""

    VIEW = "view"
    """The viewer's viewpoint comes in."""
    POSE = "pose"
    """The performers' poses go out."""
    LOOK = "look"
    """Pictures of performers go out."""
    MOTION = MOTION
    KEYPOINTS = KEYPOINTS


@dataclass(eq=False)
class ViewSession:
    """The connection of one viewer."""

    meeting_id: str
    connection: RTCPeerConnection
    track: ViewTrack
    opened_s: float
    participant_id: str | None
    """Whose seat the viewer has; None for a viewer without one."""
    account: str | None
    """Whose performers may be driven over this connection."""
    onlooker: str | None = None
    """What tells a viewer without a seat from others."""
    last_message_s: float | None = None
    """When the last viewpoint came."""
    look: LookReceiver | None = None
    """Of the viewer's pictures of themselves; None where their offer has no place for any."""
    feeds: dict[ViewChannel, RTCDataChannel] = field(default_factory=dict)
    """Where poses and pictures go out, by label."""

    def feed_by(self, channel: RTCDataChannel) -> None:
        """Have the newest channel of a label alone go out: each costs as much as another viewer."""
        label = ViewChannel(channel.label)
        if (before := self.feeds.get(label)) is not None:
            before.close()
        self.feeds[label] = channel

    def has_left(self, now_s: float) -> bool:
        """Whether the viewer has probably left."""
        if self.last_message_s is not None:
            return now_s - self.last_message_s > SILENCE_S
        return self.connection.connectionState != "connected" and now_s - self.opened_s > CONNECT_S
