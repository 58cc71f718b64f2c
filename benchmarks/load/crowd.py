"""A process full of people, and the crowd of such processes.

Each process has whole meetings, so that one clock and one memory know of each motion when it was
sent and when it came.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Any

import httpx
import numpy as np

from benchmarks.load.person import RATE_HZ, Person, SharedMeeting
from benchmarks.load.tally import Tally
from scene.errors import InvalidInput

_AT_ONCE = 8
"""People who connect at the same time: a handshake is many times dearer than a motion."""


@dataclass(frozen=True)
class Plan:
    """Who comes where."""

    addresses: tuple[str, ...]
    """Of the server, or of several that serve the same, without a path."""
    token: str
    meetings: tuple[tuple[str, tuple[str, ...]], ...]
    """The id of each, and its performers': one person comes for each."""
    patience_s: float = 90.0
    """Time in which everybody must be let in."""


class Crowd:
    """Everybody of a load test, in as many processes as are asked for."""

    def __init__(self, plan: Plan, processes: int) -> None:
        self.meeting_ids = [meeting_id for meeting_id, _ in plan.meetings]
        spawn = multiprocessing.get_context("spawn")
        self._parts: list[tuple[Any, Connection]] = []
        for number in range(min(processes, len(plan.meetings))):
            ours, theirs = spawn.Pipe()
            part = replace(plan, meetings=plan.meetings[number::processes])
            process = spawn.Process(target=_people, args=(part, theirs), daemon=True)
            process.start()
            self._parts.append((process, ours))

    def wait(self) -> None:
        """Until everybody has seen somebody move. Raises InvalidInput where somebody does not."""
        self._ask("wait")

    def meet(self) -> None:
        """Until everybody sees everybody of their meeting move. Raises InvalidInput as `wait`."""
        self._ask("meet")

    def collect(self) -> Tally:
        """What everybody counted since the last time."""
        return Tally.sum(self._ask("collect"))

    def cut(self, away_s: float) -> None:
        """Have everybody lose their network for so long, without a word."""
        self._ask(f"cut {away_s}")

    def leave(self) -> None:
        """Have everybody go."""
        for process, pipe in self._parts:
            pipe.close()
            process.join(20.0)
            process.kill()

    def _ask(self, word: str) -> list[Any]:
        for _, pipe in self._parts:
            pipe.send(word)
        answers = [pipe.recv() for _, pipe in self._parts]
        for answer in answers:
            if isinstance(answer, str):
                raise InvalidInput(answer)
        return answers


@contextmanager
def gathered(plan: Plan, processes: int, *, wait: bool = True) -> Iterator[Crowd]:
    """A crowd that is there, until the end."""
    crowd = Crowd(plan, processes)
    try:
        if wait:
            crowd.wait()
        yield crowd
    finally:
        crowd.leave()


def _people(plan: Plan, pipe: Connection) -> None:
    """The process of some of them: answers words on `pipe` until it is closed."""
    asyncio.run(_serve(plan, pipe))


async def _serve(plan: Plan, pipe: Connection) -> None:
    motions = _motions()
    header = {"Authorization": f"Bearer {plan.token}"}
    limits = httpx.Limits(max_connections=64)
    async with httpx.AsyncClient(headers=header, timeout=30.0, limits=limits) as caller:
        people = []
        for meeting_id, performer_ids in plan.meetings:
            shared = SharedMeeting(plan.addresses, meeting_id, performer_ids)
            for index in range(len(performer_ids)):
                # spread over a tick, as nobody's webcam keeps time with another's
                phase = len(people) * 0.618 % 1.0
                people.append(Person(caller, shared, index, motions, phase))
        starting = asyncio.create_task(_start(people))
        busy_s = time.process_time()
        while (word := await _heard(pipe)) is not None:
            if word in ("wait", "meet"):
                events = [one.sees_all if word == "meet" else one.connected for one in people]
                pipe.send(await _all_set(people, events, plan.patience_s))
                continue
            if word.startswith("cut "):
                for one in people:
                    one.cut(float(word.removeprefix("cut ")))
                pipe.send(None)
                continue
            tally, now_s = Tally.sum(one.collect() for one in people), time.process_time()
            tally.processor_s, busy_s = now_s - busy_s, now_s
            pipe.send(tally)
        starting.cancel()
        await asyncio.gather(*(one.leave() for one in people))


async def _heard(pipe: Connection) -> str | None:
    """The next word; None once nobody is there to say one."""
    loop, heard = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(pipe.fileno(), heard.set)
    try:
        await heard.wait()
        return pipe.recv()
    except EOFError:
        return None
    finally:
        loop.remove_reader(pipe.fileno())


async def _start(people: Sequence[Person]) -> None:
    connecting: set[asyncio.Task[bool]] = set()
    for person in people:
        if len(connecting) >= _AT_ONCE:
            _, connecting = await asyncio.wait(
                connecting, return_when=asyncio.FIRST_COMPLETED, timeout=1.0
            )
        person.start()
        connecting.add(asyncio.create_task(person.connected.wait()))


async def _all_set(
    people: Sequence[Person], events: Sequence[asyncio.Event], patience_s: float
) -> str | None:
    """None once the event of each has happened, or what is to be said of those whose has not."""
    try:
        async with asyncio.timeout(patience_s):
            for event in events:
                await event.wait()
    except TimeoutError:
        answers = sum((one.tally.answers for one in people), start=Tally().answers)
        missing = sum(not event.is_set() for event in events)
        return (
            f"everybody must be let in within {patience_s:.0f} s; got {missing} of {len(people)} "
            f"who were not, and the answers {dict(answers)}; let the server take more viewers "
            "(METANERF_MAX_VIEWERS), or ask for fewer meetings"
        )
    return None


def _motions() -> list[bytes]:
    """What a page sends that solves the poses of somebody who turns to and fro, two seconds of it;
    each is sent with a new header."""
    from benchmarks.live_people import SIZE_PX, landmarks_of_one_who_turns
    from capture.body.model import load_body_model
    from scene.skeleton import Skeleton
    from services.live.keypoints_packet import KeypointsPacket
    from services.live.motion.motion_packet import MotionPacket, encode_motion
    from services.live.motion.motion_solver import MotionSolver

    found = landmarks_of_one_who_turns()
    solver = MotionSolver(Skeleton(load_body_model().rest_joints))
    # twice round: in the second all has settled, and where it begins again nobody jumps
    motions = [
        solver.solve(
            KeypointsPacket(number, 1e3 * number / RATE_HZ, *SIZE_PX, xy, world, np.ones(len(xy)))
        )
        for number, (xy, world) in enumerate(2 * found)
    ]
    return [encode_motion(MotionPacket(0, motion)) for motion in motions[len(found) :]]
