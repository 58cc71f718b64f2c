"""A program on this device, such as OBS, that sends its video by WHIP (RFC 9725) as a webcam.

It is sent to this process, which finds the person in it and cuts them out. So what leaves the
device is the same as from a clip or a page's webcam: the room stays. Nobody else can reach the
endpoint, which listens on the loopback address; a page of the browser cannot either, as its type
of body makes browsers ask first and no answer allows them.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncGenerator, Callable, Coroutine
from concurrent.futures import Executor
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from secrets import token_urlsafe

from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from av import VideoFrame

from capture.sources.video import FilmedFrame
from scene.errors import InvalidInput
from services.joining.webcams import Webcam, WebcamFrame
from services.live.aiortc_compat import MediaStreamError

_HOST, _PATH, _SDP = "127.0.0.1", "/whip", "application/sdp"
_MOST_OFFER_BYTES = 64 * 1024
_ANSWER_S = 20.0
_LOOK_S = 0.2
"""Between looks at whether to stop, while no frame comes."""


class WhipWebcam(Webcam):
    """Takes one sender's video; a newer sender takes the place of the one before."""

    def __init__(self, port: int, *, loop: bool) -> None:
        """Raises InvalidInput where nothing can listen on `port`; 0 is any that is free. With
        `loop`, another sender is waited for when one has ended."""
        try:
            self._server = ThreadingHTTPServer((_HOST, port), _handler_of(self))
        except (OSError, OverflowError) as error:
            raise InvalidInput(
                f"--whip must be a free port of this device; got {port} ({error}); choose another"
            ) from error
        self._loop = loop
        self._running: asyncio.AbstractEventLoop | None = None
        self._sessions: dict[str, RTCPeerConnection] = {}
        self._newest: tuple[float, VideoFrame] | None = None
        self._news, self._came = asyncio.Event(), False
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def name(self) -> str:
        """The address that a program sends its video to."""
        return f"http://{_HOST}:{self._server.server_address[1]}{_PATH}"

    async def frames(
        self, executor: Executor, should_stop: Callable[[], bool]
    ) -> AsyncGenerator[WebcamFrame]:
        """Until the sender ends it (in a loop: for ever), or `should_stop`."""
        self._running = asyncio.get_running_loop()
        threading.Thread(target=self._server.serve_forever, name="whip", daemon=True).start()
        try:
            while not should_stop() and (self._loop or self._sessions or not self._came):
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._news.wait(), _LOOK_S)
                self._news.clear()
                newest, self._newest = self._newest, None
                if newest is not None:
                    captured_s, frame = newest
                    yield WebcamFrame(1e3 * captured_s, FilmedFrame(captured_s, frame))
        finally:
            # a call that waits for this loop must be able to end first
            await asyncio.to_thread(self._server.shutdown)
            self._server.server_close()
            for session_id in list(self._sessions):
                await self._end(session_id)

    def answer(self, offer: str) -> tuple[str, str]:
        """The session's path and the SDP answer, on any thread but the loop's. Raises ValueError
        for what cannot be answered."""
        assert self._running is not None
        return asyncio.run_coroutine_threadsafe(self._begin(offer), self._running).result(_ANSWER_S)

    def end(self, path: str) -> bool:
        """End a session; False where there is none. On any thread but the loop's."""
        assert self._running is not None
        ending = self._end(path.removeprefix(f"{_PATH}/"))
        return asyncio.run_coroutine_threadsafe(ending, self._running).result(_ANSWER_S)

    async def _begin(self, offer: str) -> tuple[str, str]:
        peer, session_id = RTCPeerConnection(RTCConfiguration(iceServers=[])), token_urlsafe(12)

        @peer.on("track")
        def on_track(track: MediaStreamTrack) -> None:
            if track.kind == "video":
                self._do(self._follow(session_id, track))

        @peer.on("connectionstatechange")
        async def on_state() -> None:
            if peer.connectionState in ("failed", "closed"):
                await self._end(session_id)

        try:
            await peer.setRemoteDescription(RTCSessionDescription(offer, "offer"))
            if not any(one.kind == "video" for one in peer.getTransceivers()):
                raise ValueError("no video in it")
            for transceiver in peer.getTransceivers():
                if transceiver.kind == "audio":  # a voice goes another way
                    transceiver.direction = "inactive"
            await peer.setLocalDescription(await peer.createAnswer())
        except Exception as error:
            await peer.close()
            raise ValueError(str(error) or type(error).__name__) from error
        for other in list(self._sessions):
            await self._end(other)
        self._sessions[session_id] = peer
        return f"{_PATH}/{session_id}", peer.localDescription.sdp

    async def _follow(self, session_id: str, track: MediaStreamTrack) -> None:
        with suppress(MediaStreamError):
            while True:
                frame = await track.recv()
                if isinstance(frame, VideoFrame) and session_id in self._sessions:
                    self._newest, self._came = (time.time(), frame), True
                    self._news.set()

    async def _end(self, session_id: str) -> bool:
        peer = self._sessions.pop(session_id, None)
        if peer is None:
            return False
        self._newest = None
        await peer.close()
        return True

    def _do(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def _handler_of(webcam: WhipWebcam) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        """WHIP's calls, each on a thread of its own."""

        def do_POST(self) -> None:
            """An offer."""
            length = self.headers.get("Content-Length", "")
            if self.path != _PATH:
                return self._say(HTTPStatus.NOT_FOUND, f"video is sent to {webcam.name}")
            if self.headers.get_content_type() != _SDP:
                return self._say(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"the body must be {_SDP}")
            if not length.isdigit() or int(length) > _MOST_OFFER_BYTES:
                told = f"an offer must have at most {_MOST_OFFER_BYTES} bytes; got {length!r}"
                return self._say(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, told)
            offer = self.rfile.read(int(length)).decode(errors="replace")
            try:
                path, answer = webcam.answer(offer)
            except ValueError as error:
                told = f"the offer must be an SDP with a video that sends; got {error}"
                return self._say(HTTPStatus.UNPROCESSABLE_ENTITY, told)
            return self._say(HTTPStatus.CREATED, answer, {"Location": path}, _SDP)

        def do_DELETE(self) -> None:
            """The end of a session."""
            ended = webcam.end(self.path)
            self._say(HTTPStatus.OK if ended else HTTPStatus.NOT_FOUND, "")

        def log_message(self, format: str, *args: object) -> None:
            """Nothing: the command's own words are on the terminal."""

        def _say(
            self,
            status: HTTPStatus,
            text: str,
            headers: dict[str, str] | None = None,
            kind: str = "text/plain; charset=utf-8",
        ) -> None:
            body = text.encode()
            self.send_response(status)
            described = {"Content-Type": kind, "Content-Length": str(len(body)), **(headers or {})}
            for name, value in described.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

    return Handler
