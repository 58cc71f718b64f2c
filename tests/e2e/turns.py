"""A load balancer without a memory: each connection goes to the next gateway that listens."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import AbstractContextManager
from itertools import count

from benchmarks.faults.line import pour, running

_HOST = "127.0.0.1"


class Turns:
    """Carries TCP connections to ports of this machine, by turns."""

    def __init__(self, ports: Sequence[int]) -> None:
        self._ports, self._turn = ports, count()
        self._loop = asyncio.new_event_loop()
        self._server = self._loop.run_until_complete(asyncio.start_server(self._carry, _HOST, 0))

    @property
    def address(self) -> str:
        """The address that all gateways share."""
        return f"http://{_HOST}:{self._server.sockets[0].getsockname()[1]}"

    def run(self) -> None:
        """Carry until `end`."""
        self._loop.run_forever()

    def end(self) -> None:
        """Carry no more."""
        self._loop.call_soon_threadsafe(self._loop.stop)

    async def _carry(self, reader: asyncio.StreamReader, near: asyncio.StreamWriter) -> None:
        for _ in self._ports:
            port = self._ports[next(self._turn) % len(self._ports)]
            try:
                back, far = await asyncio.open_connection(_HOST, port)
            except ConnectionError:
                continue
            await asyncio.gather(pour(reader, far), pour(back, near))
            return
        near.transport.abort()


def turns(ports: Sequence[int]) -> AbstractContextManager[Turns]:
    """A balancer that runs on a thread of its own."""
    return running(Turns(ports))
