"""The server of a load test: one that runs already, or one of its own with a temporary store."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import httpx

from benchmarks.load.crowd import Plan, gathered
from benchmarks.service import BUSY, RESIDENT, metric, running_demo
from scene.errors import InvalidInput

_COMPILED_S = 600.0
"""Time in which a server's first start on a machine must be over."""


@dataclass(frozen=True)
class Usage:
    """What the server's processes have used so far."""

    processor_s: float
    resident_bytes: float


@dataclass(frozen=True)
class Host:
    """A server, and what lets people into it."""

    address: str
    """Without a path or a slash at its end."""
    token: str
    model_id: str
    others: tuple[str, ...] = ()
    """Addresses of more gateways of the same service."""

    @property
    def addresses(self) -> tuple[str, ...]:
        """Of all its gateways."""
        return (self.address, *self.others)

    def plan(self, meetings: int, people: int) -> Plan:
        """So many new meetings of so many people. Raises InvalidInput where it opens none."""
        opened = tuple(self._open(people) for _ in range(meetings))
        return Plan(self.addresses, self.token, opened)

    def usage(self) -> Usage | None:
        """By its own figures, of all gateways together; None where it tells them to others
        alone."""
        try:
            busy, resident = (
                sum(metric(f"{address}/", name) for address in self.addresses)
                for name in (BUSY, RESIDENT)
            )
        except OSError:
            return None
        return Usage(busy, resident)

    def _open(self, people: int) -> tuple[str, tuple[str, ...]]:
        body = {"name": "Load", "model_ids": [self.model_id] * people}
        answer = httpx.post(f"{self.address}/v1/meetings", json=body, headers=self._header)
        meeting = _read(answer, "open a meeting")
        return meeting["id"], tuple(one["id"] for one in meeting["performers"])

    @property
    def _header(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.token}"}


def host_at(address: str, token: str | None, model_id: str | None) -> Host:
    """The server at `address`: by a guest's token, and with the first model, where none are given.

    Raises InvalidInput where it lets in no guests, or the account has no model.
    """
    address = address.rstrip("/")
    if token is None:
        token = str(_read(httpx.post(f"{address}/v1/guest"), "let in a guest")["token"])
    if model_id is None:
        header = {"Authorization": f"Bearer {token}"}
        models = _read(httpx.get(f"{address}/v1/models", headers=header), "list models")["items"]
        if not models:
            raise InvalidInput(
                "somebody must be there who can be moved; got an account without a model; give "
                "the token of one that has (--token), or train one first"
            )
        model_id = str(models[0]["id"])
    return Host(address, token, model_id)


@contextmanager
def own_host(most_people: int) -> Iterator[Host]:
    """A server of this machine with a temporary store, which takes so many people.

    It has compiled and loaded what it needs before anything counts.
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        running_demo(Path(folder), METANERF_MAX_VIEWERS=str(most_people)) as address,
    ):
        host = host_at(address, None, None)
        warm_up(host)
        yield host


def warm_up(host: Host) -> None:
    """Have a server compile and load what it needs before anything counts."""
    with gathered(replace(host.plan(1, 1), patience_s=_COMPILED_S), 1):
        pass


def _read(answer: httpx.Response, what: str) -> dict:
    if answer.status_code not in (200, 201):
        raise InvalidInput(
            f"the server must {what}; got {answer.status_code} with {answer.text[:200]}; give "
            "the token of an account that may (--token)"
        )
    return answer.json()
