"""A program's video as a webcam: a real WHIP sender, over HTTP and WebRTC."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import aclosing, asynccontextmanager

import httpx
import numpy as np
import pytest
from aiortc import (
    MediaStreamTrack,
    RTCConfiguration,
    RTCPeerConnection,
    RTCRtpSender,
    RTCSessionDescription,
    VideoStreamTrack,
)
from av import VideoFrame

from scene.errors import InvalidInput
from services.joining.webcams import WebcamFrame
from services.joining.whip_webcam import WhipWebcam
from tests.services.control.test_voices import Tone

SDP = {"Content-Type": "application/sdp"}
PATIENCE_S = 30.0


class Coloured(VideoStreamTrack):
    """One colour, 320 x 240 px."""

    def __init__(self, rgb: tuple[int, int, int]) -> None:
        super().__init__()
        self._picture = np.full((240, 320, 3), rgb, np.uint8)

    async def recv(self) -> VideoFrame:
        frame = VideoFrame.from_ndarray(self._picture, format="rgb24")
        frame.pts, frame.time_base = await self.next_timestamp()
        return frame


class Sender:
    """What OBS is."""

    def __init__(self, *tracks: MediaStreamTrack) -> None:
        self.peer, self.location = RTCPeerConnection(RTCConfiguration(iceServers=[])), ""
        for one in tracks:
            self.peer.addTransceiver(one, direction="sendonly")

    async def begin(self, url: str) -> None:
        """Send to `url`."""
        await self.peer.setLocalDescription(await self.peer.createOffer())
        async with httpx.AsyncClient() as caller:
            answer = await caller.post(url, content=self.peer.localDescription.sdp, headers=SDP)
        assert answer.status_code == 201, answer.text
        assert answer.headers["Content-Type"] == "application/sdp"
        self.location = str(httpx.URL(url).join(answer.headers["Location"]))
        await self.peer.setRemoteDescription(RTCSessionDescription(answer.text, "answer"))

    async def end(self) -> int:
        """The status."""
        async with httpx.AsyncClient() as caller:
            answer = await caller.delete(self.location)
        await self.peer.close()
        return answer.status_code


@asynccontextmanager
async def shown_by(webcam: WhipWebcam) -> AsyncIterator[AsyncGenerator[WebcamFrame]]:
    with ThreadPoolExecutor(1) as executor:
        async with asyncio.timeout(PATIENCE_S):
            async with aclosing(webcam.frames(executor, lambda: False)) as frames:
                yield frames


async def mean_colour(frames: AsyncGenerator[WebcamFrame], wanted: tuple[int, int, int]) -> None:
    """Wait until frames have that colour."""
    async for frame in frames:
        image = frame.frame.image(160)
        assert image.shape == (120, 160, 3)
        if np.abs(image.mean((0, 1)) - wanted).max() < 12.0:
            return


@pytest.mark.parametrize("codec", ["video/VP8", "video/H264"])
async def test_a_video_comes_until_its_sender_ends_it_and_sound_does_not(codec: str):
    red, webcam = Sender(Tone(), Coloured((200, 40, 40))), WhipWebcam(0, loop=False)
    known = RTCRtpSender.getCapabilities("video").codecs
    red.peer.getTransceivers()[1].setCodecPreferences(
        [one for one in known if one.mimeType == codec]
    )
    times: list[float] = []
    async with shown_by(webcam) as frames:
        begin = asyncio.create_task(red.begin(webcam.name))
        async for frame in frames:
            times.append(frame.captured_ms)
            if len(times) == 10:
                break
        await begin
        await mean_colour(frames, (200, 40, 40))
        audio, video = red.peer.getTransceivers()
        assert (audio.currentDirection, video.currentDirection) == ("inactive", "sendonly")
        assert await red.end() == 200
        assert [one async for one in frames] == []
    assert (np.diff(times) > 0.0).all()


async def test_a_newer_sender_takes_over_and_in_a_loop_the_next_is_waited_for():
    red, blue = Sender(Coloured((200, 40, 40))), Sender(Coloured((40, 40, 200)))
    webcam = WhipWebcam(0, loop=True)
    async with shown_by(webcam) as frames:
        first = asyncio.create_task(anext(frames))
        await red.begin(webcam.name)
        await first
        await blue.begin(webcam.name)
        await mean_colour(frames, (40, 40, 200))
        assert await red.end() == 404, "it was ended"
        assert await blue.end() == 200
        green = Sender(Coloured((40, 200, 40)))
        waiting = asyncio.create_task(mean_colour(frames, (40, 200, 40)))
        await green.begin(webcam.name)
        await waiting
        await green.peer.close()


async def test_what_is_no_offer_of_a_video_is_refused_in_words():
    webcam, talker = WhipWebcam(0, loop=False), Sender(Tone())
    await talker.peer.setLocalDescription(await talker.peer.createOffer())
    spoken = talker.peer.localDescription.sdp
    async with shown_by(webcam) as frames, httpx.AsyncClient() as caller:
        waiting = asyncio.create_task(anext(frames))
        await asyncio.sleep(0.1)
        url = webcam.name
        for where, body, headers, status, told in [
            (url, "v=0", SDP, 422, "must be an SDP with a video"),
            (url, spoken, SDP, 422, "got no video in it"),
            # what a page of another origin may send without asking
            (url, spoken, {"Content-Type": "text/plain"}, 415, "application/sdp"),
            (url, "v" * 70_000, SDP, 413, "at most 65536 bytes"),
            (f"{url}/meeting", spoken, SDP, 404, url),
        ]:
            answer = await caller.post(where, content=body, headers=headers)
            assert (answer.status_code, told in answer.text) == (status, True), answer.text
        assert (await caller.delete(f"{url}/nobody")).status_code == 404
        assert not waiting.done()
        waiting.cancel()
        await asyncio.gather(waiting, return_exceptions=True)
    await talker.peer.close()


def test_a_port_that_is_taken_is_told():
    webcam = WhipWebcam(0, loop=False)
    port = int(webcam.name.split(":")[2].partition("/")[0])
    with pytest.raises(InvalidInput, match="must be a free port of this device"):
        WhipWebcam(port, loop=False)
