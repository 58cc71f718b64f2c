"""Jobs as tasks of a Ray cluster (`metanerf worker --engine ray`, the dispatcher).

The row of a job, not Ray, decides who runs it: a task is never retried by Ray (`max_retries=0`),
for its second run would bear the number of the first attempt, and nothing could tell them apart.
What ends without a word is queued again by the dispatcher, as the next attempt.

No more jobs are leased than the cluster has free resources for, and what waits is told to its
autoscaler as the size that is asked for; with an empty queue that is nothing, so nodes may go.
One dispatcher serves a cluster, for the last to ask for a size is the one that is heard.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping

import ray
from ray import exceptions
from ray.autoscaler.sdk import request_resources

from db.models import JobKind, JobRow
from services.cluster_settings import TaskResources
from services.jobs.engine import Ended, EngineAway
from services.jobs.ray_task import run_attempt
from services.ray_cluster import ANSWER_S, AWAY_S, ClusterAway, answers, connect
from services.settings import Settings

log = logging.getLogger(__name__)

_MOST_ASKED = 100
"""Jobs that the cluster's size is asked for at once; its own bounds are far lower."""
_LOST = Ended("the Ray cluster was away", is_crash=False)


class RayEngine:
    """Runs each job as one task. Connects when it is asked for room, again where need be."""

    def __init__(self, settings: Settings) -> None:
        self._cluster, self._grace_s = settings.cluster, settings.jobs.stop_grace_s
        self._tasks: list[_Task] = []
        self._asked: list[dict[str, float]] | None = None
        self._too_large: set[JobKind] = set()
        """Kinds of which it was said that no node can hold them."""
        self._heard_s = time.monotonic()

    def kinds_with_room(self, waiting: Mapping[JobKind, int]) -> set[JobKind]:
        """See `Engine.kinds_with_room`."""
        self._connect()
        self._tasks = [task for task in self._tasks if task.ended() is None]
        self._ask_for(waiting)
        free = self._free()
        nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]
        wanted = {kind: _amounts(self._cluster.resources(kind)) for kind in waiting}
        held = {k for k, amounts in wanted.items() if any(_fits(amounts, one) for one in nodes)}
        self._tell_of(wanted.keys() - held, nodes)
        return {kind for kind in held if _fits(wanted[kind], free)}

    def start(self, job: JobRow) -> _Task:
        """See `Engine.start`."""
        task = _Task(job, self._cluster.resources(job.kind), self._grace_s)
        self._tasks.append(task)
        return task

    def close(self) -> None:
        """See `Engine.close`."""
        if ray.is_initialized():
            if answers(self._cluster.ray_address):
                request_resources(bundles=[])
            ray.shutdown()

    def _connect(self) -> None:
        """Be connected. Raises EngineAway."""
        try:
            if connect(self._cluster.ray_address):
                self._asked = None
        except ClusterAway as error:
            if ray.is_initialized() and time.monotonic() - self._heard_s > AWAY_S:
                self._give_up()
            raise EngineAway(str(error)) from error
        self._heard_s = time.monotonic()

    def _give_up(self) -> None:
        for task in self._tasks:
            task.lose()
        self._tasks.clear()
        ray.shutdown()

    def _ask_for(self, waiting: Mapping[JobKind, int]) -> None:
        """Tell the autoscaler what the cluster should hold: all that runs, and all that waits."""
        bundles = [task.amounts for task in self._tasks]
        for kind in sorted(waiting):
            amounts = _amounts(self._cluster.resources(kind))
            bundles += [amounts] * min(waiting[kind], _MOST_ASKED - len(bundles))
        if bundles != self._asked:
            request_resources(bundles=bundles)
            self._asked = bundles

    def _tell_of(self, too_large: set[JobKind], nodes: list[dict[str, float]]) -> None:
        """Say once of each kind that it is too large for all nodes; one that is empty may grow."""
        there = [f"{one['CPU']:g} CPU, {one.get('GPU', 0):g} GPU" for one in nodes if "CPU" in one]
        for kind in sorted(too_large - self._too_large) if there else ():
            self._too_large.add(kind)
            log.warning(
                "a node must have what a %s takes, %s; got nodes with %s; such jobs wait for a "
                "larger node: add one, or correct METANERF_%s_RESOURCES",
                kind,
                self._cluster.resources(kind).model_dump_json(),
                "; ".join(sorted(set(there))),
                kind.upper(),
            )

    def _free(self) -> dict[str, float]:
        """What no task holds. Ray tells it with a lag, within which our own tasks are known."""
        told: Mapping[str, float] = ray.available_resources()
        held: dict[str, float] = {**ray.cluster_resources()}
        for task in self._tasks:
            for name, amount in task.amounts.items():
                held[name] = held.get(name, 0.0) - amount
        return {name: min(told.get(name, 0.0), amount) for name, amount in held.items()}


class _Task:
    """An execution on a node."""

    def __init__(self, job: JobRow, resources: TaskResources, grace_s: float) -> None:
        self.amounts = _amounts(resources)
        self._grace_s = grace_s
        self._asked_to_stop_s: float | None = None
        self._ended: Ended | None = None
        self._nodes = _nodes()
        """Those of which one runs it."""
        task = ray.remote(
            num_cpus=resources.num_cpus,
            num_gpus=resources.num_gpus,
            memory=resources.memory,
            max_retries=0,
        )(run_attempt)
        self._ref = task.options(name=f"{job.kind} {job.id}").remote(job.id, job.attempt)

    def ended(self) -> Ended | None:
        """See `Execution.ended`."""
        if self._ended is None and ray.wait([self._ref], timeout=0)[0]:
            self._ended = self._outcome()
        return self._ended

    def stop(self) -> None:
        """See `Execution.stop`: the node gives the process its grace; beyond, the node itself is
        not heard, and Ray's worker is killed."""
        if self.ended() is not None:
            return
        now = time.monotonic()
        if self._asked_to_stop_s is None:
            self._asked_to_stop_s = now
            ray.cancel(self._ref, force=False)
        elif now - self._asked_to_stop_s > self._grace_s + ANSWER_S:
            ray.cancel(self._ref, force=True)

    def lose(self) -> None:
        """Its cluster is away."""
        self._ended = self._ended or _LOST

    def _outcome(self) -> Ended:
        try:
            return Ended.with_code(ray.get(self._ref))
        except exceptions.TaskCancelledError:
            return Ended("no node had room for it in time", is_crash=False)
        except (exceptions.NodeDiedError, exceptions.LocalRayletDiedError):
            return Ended("its node is gone", is_crash=False)
        except exceptions.OutOfMemoryError:
            return Ended("its node ran out of memory", is_crash=True)
        except exceptions.WorkerCrashedError:
            # the end of a worker is heard of before that of its node
            if any(_nodes().get(node) != at or not answers(at) for node, at in self._nodes.items()):
                return Ended("its node is gone", is_crash=False)
            return Ended("its Ray worker died", is_crash=True)
        except exceptions.RayError as error:
            reason = str(error).strip().rpartition("\n")[2]
            return Ended(f"its node could not run it: {reason}", is_crash=True)


def _nodes() -> dict[str, str]:
    """Where each node that is there listens, HOST:PORT, by its id."""
    return {
        node["NodeID"]: f"{node['NodeManagerAddress']}:{node['NodeManagerPort']}"
        for node in ray.nodes()
        if node["Alive"]
    }


def _amounts(resources: TaskResources) -> dict[str, float]:
    """By the names under which the cluster counts them."""
    named = {"CPU": resources.num_cpus, "GPU": resources.num_gpus, "memory": resources.memory}
    return {name: float(amount) for name, amount in named.items() if amount}


def _fits(amounts: Mapping[str, float], free: Mapping[str, float]) -> bool:
    return all(amount <= free.get(name, 0.0) for name, amount in amounts.items())
