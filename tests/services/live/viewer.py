"""A WebRTC viewer that is not ours: plain aiortc."""

from __future__ import annotations

import asyncio

import httpx
import numpy as np
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from av import VideoFrame

from scene import look_at
from scene.rotations import matrix_to_quaternion
from services.live.packets import ViewPacket, encode_view


def view(sequence: int, x: float, z: float, size: int = 160) -> bytes:
    """A viewpoint at (x, 1.2, z) m that looks at the person at the origin."""
    pose = look_at((x, 1.2, z), (0.0, 0.9, 0.0))
    w, qx, qy, qz = (float(q) for q in matrix_to_quaternion(pose[:, :3].T.copy()))
    packet = ViewPacket(sequence, 0.0, (x, 1.2, z), (w, qx, qy, qz), 0.7, size, size)
    return encode_view(packet)


class Viewer:
    """One connection: a data channel up, a video down."""

    def __init__(self, configuration: RTCConfiguration | None = None) -> None:
        self.peer = RTCPeerConnection(configuration or RTCConfiguration(iceServers=[]))
        self.channel = self.peer.createDataChannel("view", ordered=False, maxRetransmits=0)
        self.receiver = self.peer.addTransceiver("video", direction="recvonly").receiver

    async def offer(self) -> str:
        """What to post."""
        await self.peer.setLocalDescription(await self.peer.createOffer())
        return self.peer.localDescription.sdp

    async def accept(self, answer: str) -> None:
        """Connect by the server's answer."""
        await self.peer.setRemoteDescription(RTCSessionDescription(answer, "answer"))

    async def look(
        self, caller: httpx.AsyncClient, meeting_id: str, header: dict[str, str]
    ) -> httpx.Response:
        """Ask for a view by WHEP; connects where it is granted."""
        answer = await caller.post(
            f"/whep/{meeting_id}",
            content=await self.offer(),
            headers=header | {"Content-Type": "application/sdp"},
        )
        if answer.status_code == 201:
            await self.accept(answer.text)
        return answer

    async def frame(self) -> np.ndarray:
        """The next picture, H x W x 3."""
        frame = await asyncio.wait_for(self.receiver.track.recv(), 20)
        assert isinstance(frame, VideoFrame)
        return frame.to_ndarray(format="rgb24")

    async def frame_of_size(self, size: int) -> np.ndarray:
        """The next picture of `size` px."""
        for _ in range(90):
            picture = await self.frame()
            if picture.shape[0] == size:
                return picture
        raise AssertionError(f"no picture of {size} px came")

    async def opened(self) -> None:
        """Wait until viewpoints can be sent."""
        for _ in range(200):
            if self.channel.readyState == "open":
                return
            await asyncio.sleep(0.05)
        raise AssertionError("the data channel did not open")
