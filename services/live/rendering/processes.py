"""Renderers as child processes of this machine, reached by their pipes."""

from __future__ import annotations

import asyncio
import itertools
import os
import sys
from asyncio.subprocess import PIPE, Process
from contextlib import suppress

from services.live.rendering.child import ANSWER, REQUEST, Lane
from services.live.rendering.homes import Renderer, RendererGone, RendererHome
from services.live.rendering.messages import pack
from services.logs import LogStyle

_START_S = 180.0
"""The first start on a machine compiles."""
_SILENT_S = 20.0
"""A renderer that takes longer for one answer hangs, however busy its machine."""
_END_S = 2.0
_OURS = "METANERF_"


class ProcessHome(RendererHome):
    """Each renderer is a process."""

    def __init__(self, most: int, log: LogStyle | None = None, silent_s: float = _SILENT_S) -> None:
        """`most` of them draw at once, share the cores, and log as `log` says; one that takes
        longer than `silent_s` for an answer is killed."""
        self._silent_s, self._log = silent_s, log or LogStyle("text", "warning", "")
        cores = os.cpu_count() or 1
        # what it is not told it cannot give away
        environment = {k: v for k, v in os.environ.items() if not k.upper().startswith(_OURS)}
        environment.setdefault("NUMBA_NUM_THREADS", str(max(1, cores // most)))
        self._environment = environment

    def renderer(self) -> RendererProcess:
        """See `RendererHome.renderer`."""
        return RendererProcess(self._environment, self._log, self._silent_s)

    async def close(self) -> None:
        """See `RendererHome.close`."""


class RendererProcess(Renderer):
    """`services.live.rendering.child`, started anew where it was lost."""

    def __init__(self, environment: dict[str, str], log: LogStyle, silent_s: float) -> None:
        self._environment, self._log, self._silent_s = environment, log, silent_s
        self._process: Process | None = None
        self._warm = False
        self._reading: asyncio.Task[None] | None = None
        self._numbers = itertools.count()
        self._waiting: dict[int, asyncio.Future[bytes]] = {}

    @property
    def process_id(self) -> int | None:
        """Of the process that runs now."""
        return None if self._process is None else self._process.pid

    async def start(self) -> None:
        """See `Renderer.start`."""
        await self.end()
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "services.live.rendering.child",
            *self._log,
            stdin=PIPE,
            stdout=PIPE,
            env=self._environment,
            start_new_session=True,  # Ctrl-C is the gateway's alone
        )
        self._reading = asyncio.create_task(self._read(self._process))
        await self._ask(self._process, Lane.DRAW, pack({"act": "ping"}), _START_S)
        self._warm = True

    async def draw(self, request: bytes) -> bytes:
        """See `Renderer.draw`."""
        return await self._ask(self._require_warm(), Lane.DRAW, request, self._silent_s)

    async def load(self, request: bytes) -> bytes:
        """See `Renderer.load`."""
        return await self._ask(self._require_warm(), Lane.LOAD, request, self._silent_s)

    async def end(self) -> None:
        """See `Renderer.end`."""
        process, self._process, self._warm = self._process, None, False
        if process is None:
            return
        assert process.stdin is not None
        process.stdin.close()
        try:
            async with asyncio.timeout(_END_S):
                await process.wait()
        except TimeoutError:
            _kill(process)
            await process.wait()
        if self._reading is not None:
            await self._reading

    def _require_warm(self) -> Process:
        # what is asked while it starts would wait for long, and look like silence
        if self._process is None or self._process.returncode is not None or not self._warm:
            raise RendererGone("a renderer must run; got one that has ended")
        return self._process

    async def _ask(self, process: Process, lane: Lane, request: bytes, within_s: float) -> bytes:
        assert process.stdin is not None
        number = next(self._numbers) % (1 << 32)
        answer = self._waiting[number] = asyncio.get_running_loop().create_future()
        try:
            async with asyncio.timeout(within_s):
                process.stdin.write(REQUEST.pack(len(request), number, lane) + request)
                await process.stdin.drain()
                return await answer
        except TimeoutError as error:
            _kill(process)
            raise RendererGone(
                f"a renderer must answer within {within_s:g} s; got none, so it was killed; if it "
                "happens again, look for what else takes the cores of this machine"
            ) from error
        except ConnectionError as error:
            raise RendererGone(f"a renderer must take requests; got {error}") from error
        finally:
            self._waiting.pop(number, None)

    async def _read(self, process: Process) -> None:
        """Hand out answers until the process is gone."""
        assert process.stdout is not None
        with suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                head = await process.stdout.readexactly(ANSWER.size)
                length, number = ANSWER.unpack(head)
                answer = await process.stdout.readexactly(length)
                if (waiting := self._waiting.get(number)) is not None and not waiting.done():
                    waiting.set_result(answer)
        code = await process.wait()
        error = RendererGone(f"a renderer must run; got one that ended with code {code}")
        for waiting in self._waiting.values():
            if not waiting.done():
                waiting.set_exception(error)


def _kill(process: Process) -> None:
    with suppress(ProcessLookupError):
        process.kill()
