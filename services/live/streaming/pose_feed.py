"""Poses to the viewers who draw the room themselves: the newest, 30 times a second, none queued.

Poses are encoded once for all viewers of a room. Where no viewer draws for themselves nothing is
encoded and nothing is sent.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from aiortc import RTCDataChannel

from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float
from scene.environment import Performer
from scene.rotations import axis_angle_to_matrix, matrix_to_quaternion
from services.live.packets import (
    POSE_BYTES,
    NewestView,
    PosePacket,
    encode_pose,
    performer_check,
)
from services.live.room import Room
from services.live.streaming.instrumentation import Instrumentation

POSES_PER_SECOND = 30
_MOST_BUFFERED_BYTES = 24 * POSE_BYTES
"""A channel with more than this unsent is congested: what comes next would only be older."""


@dataclass(frozen=True, eq=False)
class _Subscriber:
    room: Room
    view: NewestView
    channel: RTCDataChannel


class PoseFeed:
    """Sends every room's poses to its viewers; runs as long as there are subscribers."""

    def __init__(self, clock: Callable[[], float], instrumentation: Instrumentation) -> None:
        self._clock, self._instrumentation = clock, instrumentation
        self._subscribers: dict[RTCDataChannel, _Subscriber] = {}
        self._sequence = 0
        self._task: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        return len(self._subscribers)

    def add(self, room: Room, view: NewestView, channel: RTCDataChannel) -> None:
        """Send the poses of `room` over `channel` whenever its viewer draws for themselves."""
        self._subscribers[channel] = _Subscriber(room, view, channel)
        if self._task is None:
            self._task = asyncio.create_task(self._run())

    def send_newest(self) -> None:
        """Send everybody's pose now to every viewer who draws."""
        self._subscribers = {
            channel: subscriber
            for channel, subscriber in self._subscribers.items()
            if channel.readyState in ("connecting", "open")
        }
        self._sequence = (self._sequence + 1) % (1 << 32)
        encoded: dict[Room, list[bytes]] = {}
        for subscriber in self._subscribers.values():
            channel = subscriber.channel
            if not subscriber.view.wants_poses or channel.readyState != "open":
                continue
            if channel.bufferedAmount > _MOST_BUFFERED_BYTES:
                continue
            if subscriber.room not in encoded:
                encoded[subscriber.room] = self._packets(subscriber.room)
            for data in encoded[subscriber.room]:
                channel.send(data)

    async def close(self) -> None:
        """Stop sending; returns once nothing of it runs any more."""
        self._subscribers = {}
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])

    def _packets(self, room: Room) -> list[bytes]:
        now_s = self._clock()
        time_ms = self._instrumentation.pose_time_ms(room, now_s)
        return pose_packets(room, now_s, self._sequence, time_ms)

    async def _run(self) -> None:
        due_s = self._clock()
        try:
            while self._subscribers:
                self.send_newest()
                now_s = self._clock()
                due_s = max(due_s + 1.0 / POSES_PER_SECOND, now_s)
                await asyncio.sleep(due_s - now_s)
        finally:
            self._task = None  # the next subscriber starts it anew


def pose_packets(
    room: Room, now_s: float, sequence: int, time_ms: float | None = None
) -> list[bytes]:
    """A pose packet for each performer of `room` at `now_s`; it carries `time_ms`, else `now_s`."""
    time_ms = 1000.0 * now_s if time_ms is None else time_ms
    members, performers = room.performers, room.scene_at(now_s).performers
    packets = []
    for index, (member, performer) in enumerate(zip(members, performers, strict=True)):
        pelvis, rotations = room_pose(performer)
        check = performer_check(member.performer_id)
        live = room.live_motions.get(member.performer_id)
        packets.append(
            PosePacket(
                sequence,
                time_ms,
                index,
                len(members),
                check,
                pelvis,
                rotations,
                0 if live is None else live.landmarks_age_ms,
                performer.pose.expression,
            )
        )
    return [encode_pose(packet) for packet in packets]


def room_pose(
    performer: Performer[PerformerModel],
) -> tuple[Float[Array, "3"], Float[Array, "24 4"]]:
    """Position of the pelvis in the room (m), and the rotations wxyz of a `PosePacket`."""
    pose, placement = performer.pose, performer.placement
    rotations = axis_angle_to_matrix(pose.joint_angles)
    rotations[0] = placement[:3, :3] @ rotations[0]
    pelvis = performer.model.skeleton.rest_joints[0] + pose.root_translation
    return placement[:3, :3] @ pelvis + placement[:3, 3], matrix_to_quaternion(rotations)
