"""A line between a page's browser and the service on which what TCP carries comes late."""

from __future__ import annotations

import asyncio
from contextlib import AbstractContextManager

from benchmarks.faults.line import running

_HOST = "127.0.0.1"
_MOST_BYTES = 16_384


class LateLine:
    """Carries TCP connections to a port of this machine."""

    def __init__(self, port: int) -> None:
        self.late_s = 0.0
        """How late each piece comes, either way."""
        self._port, self._loop = port, asyncio.new_event_loop()
        self._server = self._loop.run_until_complete(asyncio.start_server(self._carry, _HOST, 0))

    @property
    def address(self) -> str:
        """By which a browser reaches the service over this line."""
        return f"http://{_HOST}:{self._server.sockets[0].getsockname()[1]}/"

    def run(self) -> None:
        """Carry until `end`."""
        self._loop.run_forever()

    def end(self) -> None:
        """Carry no more."""
        self._loop.call_soon_threadsafe(self._loop.stop)

    async def _carry(self, reader: asyncio.StreamReader, near: asyncio.StreamWriter) -> None:
        try:
            back, far = await asyncio.open_connection(_HOST, self._port)
        except ConnectionError:
            near.transport.abort()
            return
        await asyncio.gather(self._pour(reader, far), self._pour(back, near))

    async def _pour(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while data := await reader.read(_MOST_BYTES):
                await asyncio.sleep(self.late_s)
                writer.write(data)
                await writer.drain()
        except ConnectionError:
            pass
        writer.close()


def late_line(port: int) -> AbstractContextManager[LateLine]:
    """A line that runs on a thread of its own."""
    return running(LateLine(port))
