"""People as webcams see them, without webcams: landmarks go to a meeting 30 times a second."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import httpx
import numpy as np
from aiortc import RTCConfiguration, RTCDataChannel, RTCPeerConnection, RTCSessionDescription

from capture.body.landmark_names import LANDMARK_NAMES
from capture.body.landmarks import load_body_landmarks
from capture.body.model import load_body_model
from capture.studio.motions import turntable_motion
from scene.camera import orbit_camera
from scene.skeleton import Skeleton
from services.live.keypoints_packet import KeypointsPacket, encode_keypoints
from services.live.packets import ViewPacket, encode_view

RATE_HZ = 30
SIZE_PX = (640, 480)
_FRAMES = 60
NEWEST = {"ordered": False, "maxRetransmits": 0}
_AT_WORST_S = 60.0


class LivePeople:
    """One connection that drives performers; no pictures are made for it."""

    def __init__(
        self, address: str, meeting_id: str, token: str, performers: Sequence[str]
    ) -> None:
        self.bytes_sent = 0
        """Landmarks of all performers so far, without what carries them."""
        self.performers = tuple(performers)
        self._address, self._meeting_id, self._token = address, meeting_id, token
        self._poses = landmarks_of_one_who_turns()
        self._moving, self._end = threading.Event(), threading.Event()

    @contextmanager
    def moving(self) -> Iterator[None]:
        """Drive everybody, on a thread of its own."""
        thread = threading.Thread(target=lambda: asyncio.run(self._drive()), daemon=True)
        thread.start()
        try:
            if not self._moving.wait(_AT_WORST_S):
                raise RuntimeError("performers must move within a minute; got none that did")
            yield
        finally:
            self._end.set()
            thread.join(10.0)

    async def _drive(self) -> None:
        peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        view = peer.createDataChannel("view", **NEWEST)
        channels = [
            peer.createDataChannel("keypoints", protocol=performer, **NEWEST)
            for performer in self.performers
        ]
        peer.addTransceiver("video", direction="recvonly")
        await connect(peer, f"{self._address}whep/{self._meeting_id}", self._token)
        sequence, due_s = 0, time.monotonic()
        while not self._end.is_set():
            sequence += 1
            if view.readyState == "open" and sequence % 10 == 1:
                view.send(_looking(sequence))
            for offset, channel in enumerate(channels):
                self._send(channel, sequence, sequence + 7 * offset)
            due_s = max(due_s + 1.0 / RATE_HZ, time.monotonic())
            await asyncio.sleep(due_s - time.monotonic())
        await peer.close()

    def _send(self, channel: RTCDataChannel, sequence: int, frame: int) -> None:
        if channel.readyState != "open":
            return
        xy, world = self._poses[frame % _FRAMES]
        now_ms = 1e3 * time.time()  # the page that looks on reads this machine's clock, too
        packet = KeypointsPacket(sequence, now_ms, *SIZE_PX, xy, world, np.ones(len(xy)))
        data = encode_keypoints(packet)
        channel.send(data)
        self.bytes_sent += len(data)
        self._moving.set()


async def connect(peer: RTCPeerConnection, url: str, token: str) -> None:
    """Offer what `peer` has to a service's endpoint at `url`, and take its answer."""
    await peer.setLocalDescription(await peer.createOffer())
    header = {"Authorization": f"Bearer {token}", "Content-Type": "application/sdp"}
    async with httpx.AsyncClient(timeout=_AT_WORST_S) as caller:
        answer = await caller.post(url, content=peer.localDescription.sdp, headers=header)
    answer.raise_for_status()
    await peer.setRemoteDescription(RTCSessionDescription(answer.text, "answer"))


def _looking(sequence: int) -> bytes:
    packet = ViewPacket(
        sequence, 0.0, (0.0, 1.0, 3.0), (0.0, 1.0, 0.0, 0.0), 0.7, 128, 128, draws_itself=True
    )
    return encode_view(packet)


def landmarks_of_one_who_turns() -> list[tuple[np.ndarray, np.ndarray]]:
    """What a perfect estimator says of somebody who turns to and fro: shares of the picture, m."""
    skeleton, marks = Skeleton(load_body_model().rest_joints), load_body_landmarks()
    camera = orbit_camera((0.0, 0.9, 0.0), 3.0, 0.0, 0.0, *SIZE_PX, 0.8)
    hips = [LANDMARK_NAMES.index(f"{side}_hip") for side in ("left", "right")]
    motion, found = turntable_motion(_FRAMES, float(RATE_HZ), 60.0), []
    for frame in range(_FRAMES):
        # forwards and back: where the round begins again nobody jumps
        pose = motion.pose(2 * min(frame, _FRAMES - 1 - frame))
        moved = skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)[marks.joints]
        points = np.einsum("nij,nj->ni", moved[:, :3, :3], marks.rest) + moved[:, :3, 3]
        pixels, _ = camera.project(points)
        centre = points[hips].mean(axis=0)
        found.append((pixels / SIZE_PX, (points - centre) @ camera.rotation.T))
    return found
