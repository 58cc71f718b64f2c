"""Renderers as actors of a Ray cluster.

Ray starts an actor anew whose process or node was lost (`max_restarts`), and never asks it the same
twice (`max_task_retries=0`): what is asked next is newer. Each takes a share of a node's
resources, and actors end with the gateway whose they are, however it ends. This machine must be a
node of the cluster, if only one without processors.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from typing import Any

import ray
from ray import exceptions

from services.cluster_settings import TaskResources
from services.live.rendering.homes import Renderer, RendererGone, RendererHome
from services.live.rendering.messages import pack
from services.live.rendering.ray_actor import RendererActor
from services.ray_cluster import AWAY_S, ClusterAway, answers, connect

log = logging.getLogger(__name__)

_RESTARTS = 3
"""Of one actor by Ray; then another takes its place."""
_START_S = 180.0
"""The first start on a machine compiles; where no node has room, an actor waits for one."""
_AGAIN_S = 0.1
_SILENT_S = 20.0
"""A renderer that takes longer for one answer hangs."""
_LOOK_S = 2.0
_DRAW, _LOAD = "draw", "load"


class RayHome(RendererHome):
    """Each renderer is an actor."""

    def __init__(self, address: str, resources: TaskResources) -> None:
        """The cluster's head is at `address`, HOST:PORT; an actor takes `resources`."""
        self._address, self._resources = address, resources
        self._connecting = asyncio.Lock()
        self.connection = 0
        """Which connection to the cluster this is: what was made by an earlier one is lost."""
        self._watching: asyncio.Task[None] | None = None

    def renderer(self) -> RayRenderer:
        """See `RendererHome.renderer`."""
        return RayRenderer(self)

    async def close(self) -> None:
        """See `RendererHome.close`."""
        if self._watching is not None:
            self._watching.cancel()
        await asyncio.to_thread(ray.shutdown)

    @property
    def is_connected(self) -> bool:
        """Whether the connection stands."""
        return ray.is_initialized()

    async def connect(self) -> None:
        """Have a connection. Raises RendererGone."""
        async with self._connecting:
            try:
                self.connection += await asyncio.to_thread(connect, self._address)
            except ClusterAway as error:
                raise RendererGone(str(error)) from error
        if self._watching is None or self._watching.done():
            self._watching = asyncio.create_task(self._watch())

    def actor(self) -> Any:
        """A new actor, which is asked by the names of its methods; over a connection."""
        wanted = self._resources
        remote: Any = ray.remote  # its types know nothing of concurrency groups
        make = remote(
            num_cpus=wanted.num_cpus,
            num_gpus=wanted.num_gpus,
            memory=wanted.memory,
            max_restarts=_RESTARTS,
            max_task_retries=0,
            concurrency_groups={_DRAW: 1, _LOAD: 1},
        )(RendererActor)
        return make.remote(math.ceil(wanted.num_cpus))

    async def _watch(self) -> None:
        """Let go of a cluster whose head is silent."""
        heard_s = time.monotonic()
        while time.monotonic() - heard_s < AWAY_S:
            await asyncio.sleep(_LOOK_S)
            if await asyncio.to_thread(answers, self._address):
                heard_s = time.monotonic()
        await asyncio.to_thread(ray.shutdown)


class RayRenderer(Renderer):
    """One actor, or the next one where Ray has given it up."""

    def __init__(self, home: RayHome) -> None:
        self._home = home
        self._actor: Any = None
        self._connection, self._warm = 0, False

    async def start(self) -> None:
        """See `Renderer.start`."""
        give_up_s, self._warm = time.monotonic() + _START_S, False
        await self._home.connect()
        if self._connection != self._home.connection:
            self._actor, self._connection = None, self._home.connection
        for actor in (self._actor, None):
            self._actor = actor or self._home.actor()
            if await self._gets_warm(give_up_s):
                self._warm = True
                return
        raise RendererGone(
            f"a node of the Ray cluster must start a renderer within {_START_S:g} s; got none that "
            "did; add a node, or have one take less (METANERF_RENDERER_RESOURCES)"
        )

    async def draw(self, request: bytes) -> bytes:
        """See `Renderer.draw`."""
        return await self._ask(_DRAW, request, _SILENT_S)

    async def load(self, request: bytes) -> bytes:
        """See `Renderer.load`."""
        return await self._ask(_LOAD, request, _SILENT_S)

    async def end(self) -> None:
        """See `Renderer.end`."""
        actor, self._actor, self._warm = self._actor, None, False
        if actor is not None and self._is_of_now:
            await asyncio.to_thread(ray.kill, actor)

    @property
    def _is_of_now(self) -> bool:
        # asked over none, Ray would begin a cluster of its own
        return self._home.is_connected and self._connection == self._home.connection

    async def _gets_warm(self, give_up_s: float) -> bool:
        """Wait for it while Ray starts it; False once it will not be."""
        while (left_s := give_up_s - time.monotonic()) > 0.0:
            try:
                await self._answer(_DRAW, pack({"act": "ping"}), left_s)
                return True
            except exceptions.ActorUnavailableError:
                await asyncio.sleep(_AGAIN_S)
            except (exceptions.RayError, TimeoutError) as error:
                log.warning("a renderer did not start on the Ray cluster: %s", error)
                break
        await self.end()
        return False

    async def _ask(self, group: str, request: bytes, within_s: float) -> bytes:
        # what is asked while it starts would wait for long, and look like silence
        if not self._warm or not self._is_of_now:
            raise RendererGone("a renderer must run; got one that has ended, or no cluster")
        try:
            return await self._answer(group, request, within_s)
        except exceptions.RayError as error:
            self._warm = False
            reason = str(error).strip().partition("\n")[0]
            raise RendererGone(f"a renderer must run; got: {reason}") from error
        except TimeoutError as error:
            await self.end()
            raise RendererGone(
                f"a renderer must answer within {within_s:g} s; got none, so it was ended; if it "
                "happens again, look for what else takes the cores of its node"
            ) from error

    async def _answer(self, group: str, request: bytes, within_s: float) -> bytes:
        asked = self._actor.answer.options(concurrency_group=group).remote(request)
        async with asyncio.timeout(within_s):
            return await asyncio.wrap_future(asked.future())
