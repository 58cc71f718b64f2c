"""Poses to the viewers who draw for themselves: 30 times a second the newest, nothing queued.

A pose is encoded once for all who look into its room. Where nobody draws for themselves nothing is
encoded and nothing sent.
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

POSES_PER_SECOND = 30
_MOST_WAITING_BYTES = 24 * POSE_BYTES
"""A channel with more than this unsent is clogged: what comes next would only be older."""


@dataclass(frozen=True, eq=False)
class _Listener:
    room: Room
    view: NewestView
    channel: RTCDataChannel


class PoseFeed:
    """Sends every room's poses to its viewers; runs as long as somebody listens."""

    def __init__(self, clock: Callable[[], float], *, stamped: bool = False) -> None:
        """With `stamped`, poses carry when the newest was captured; see services.live.stamp."""
        self._clock, self._stamped = clock, stamped
        self._listeners: dict[RTCDataChannel, _Listener] = {}
        self._sequence = 0
        self._task: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        return len(self._listeners)

    def add(self, room: Room, view: NewestView, channel: RTCDataChannel) -> None:
        """Send the poses of `room` over `channel` whenever its viewer draws for themselves."""
        self._listeners[channel] = _Listener(room, view, channel)
        if self._task is None:
            self._task = asyncio.create_task(self._run())

    def send_newest(self) -> None:
        """One round: the pose of everybody now to everyone who draws."""
        self._listeners = {
            channel: listener
            for channel, listener in self._listeners.items()
            if channel.readyState in ("connecting", "open")
        }
        self._sequence = (self._sequence + 1) % (1 << 32)
        encoded: dict[Room, list[bytes]] = {}
        for listener in self._listeners.values():
            channel = listener.channel
            if not listener.view.wants_poses or channel.readyState != "open":
                continue
            if channel.bufferedAmount > _MOST_WAITING_BYTES:
                continue
            if listener.room not in encoded:
                encoded[listener.room] = self._packets(listener.room)
            for data in encoded[listener.room]:
                channel.send(data)

    def _packets(self, room: Room) -> list[bytes]:
        captured_ms = room.captured_ms() if self._stamped else None
        return packets_of(room, self._clock(), self._sequence, captured_ms)

    async def _run(self) -> None:
        due_s = self._clock()
        try:
            while self._listeners:
                self.send_newest()
                now_s = self._clock()
                due_s = max(due_s + 1.0 / POSES_PER_SECOND, now_s)
                await asyncio.sleep(due_s - now_s)
        finally:
            self._task = None  # the next to listen starts it anew


def packets_of(
    room: Room, now_s: float, sequence: int, time_ms: float | None = None
) -> list[bytes]:
    """A pose packet a performer of `room`, as they stand at `now_s`; it says that, or `time_ms`."""
    time_ms = 1000.0 * now_s if time_ms is None else time_ms
    cast, performers = room.cast, room.scene_at(now_s).performers
    packets = []
    for index, (member, performer) in enumerate(zip(cast, performers, strict=True)):
        pelvis, turns = standing(performer)
        check = performer_check(member.performer_id)
        packets.append(
            PosePacket(
                sequence, time_ms, index, len(cast), check, pelvis, turns,
                performer.pose.expression,
            )
        )  # fmt: skip
    return [encode_pose(packet) for packet in packets]


def standing(
    performer: Performer[PerformerModel],
) -> tuple[Float[Array, "3"], Float[Array, "24 4"]]:
    """Where the pelvis is in the room (m), and the turns wxyz of a `PosePacket`."""
    pose, placement = performer.pose, performer.placement
    turns = axis_angle_to_matrix(pose.joint_angles)
    turns[0] = placement[:3, :3] @ turns[0]
    pelvis = performer.model.skeleton.rest_joints[0] + pose.root_translation
    return placement[:3, :3] @ pelvis + placement[:3, 3], matrix_to_quaternion(turns)
