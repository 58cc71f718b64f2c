"""A line between two programs of this machine that can be cut, and mended."""

from __future__ import annotations

import asyncio
from contextlib import AbstractContextManager

from benchmarks.faults.line import pour, running

_MOST_BYTES = 16_384
_HOST = "127.0.0.1"


class CutLine:
    """Carries TCP connections to one port of this machine."""

    def __init__(self, port: int) -> None:
        self.carried_bytes = 0
        """What the service was sent so far."""
        self.cut_at: int | None = None
        """So many carried bytes, and the line is cut; None: it holds."""
        self._far_port = port
        self._near: set[asyncio.StreamWriter] = set()
        self._loop = asyncio.new_event_loop()
        self._server = self._loop.run_until_complete(asyncio.start_server(self._carry, _HOST, 0))

    @property
    def address(self) -> str:
        """By which the near end reaches the far one over this line."""
        return f"http://{_HOST}:{self._server.sockets[0].getsockname()[1]}/"

    @property
    def is_cut(self) -> bool:
        """Whether nothing gets through."""
        return self.cut_at is not None and self.carried_bytes >= self.cut_at

    def run(self) -> None:
        """Carry until `end`."""
        self._loop.run_forever()

    def end(self) -> None:
        """Carry no more."""
        self._loop.call_soon_threadsafe(self._loop.stop)

    async def _carry(self, reader: asyncio.StreamReader, near: asyncio.StreamWriter) -> None:
        if self.is_cut:
            near.transport.abort()
            return
        back, far = await asyncio.open_connection(_HOST, self._far_port)
        self._near.add(near)
        await asyncio.gather(self._to_service(reader, far), pour(back, near))
        self._near.discard(near)

    async def _to_service(self, reader: asyncio.StreamReader, far: asyncio.StreamWriter) -> None:
        try:
            while not self.is_cut and (data := await reader.read(_MOST_BYTES)):
                if self.cut_at is not None:
                    data = data[: self.cut_at - self.carried_bytes]
                self.carried_bytes += len(data)
                far.write(data)
                await far.drain()
        except ConnectionError:
            pass
        far.close()
        if self.is_cut:
            for near in self._near:
                near.transport.abort()


def cut_line(port: int) -> AbstractContextManager[CutLine]:
    """A line that runs on a thread of its own."""
    return running(CutLine(port))
