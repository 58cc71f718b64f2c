"""Networks of this machine that reach each other by nothing but the lines laid between them."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager

from tests.servers import program, unavailable

_PATIENCE_S = 10.0


class Network:
    """A network namespace (network_namespaces(7)), kept by a process that sleeps."""

    def __init__(self, holder: subprocess.Popen[str]) -> None:
        self._holder = holder

    @property
    def holder(self) -> str:
        """The id of the process that keeps it."""
        return str(self._holder.pid)

    def command(self, *words: str) -> list[str]:
        """A command that runs in it."""
        own = ["--target", self.holder, "--user", "--preserve-credentials", "--net"]
        return [program("nsenter"), *own, "--", *words]

    def ip(self, words: str) -> None:
        """What ip(8) does there."""
        subprocess.run(self.command(program("ip"), *words.split()), check=True)

    def lay_line(self, name: str, own: str, to: Network, far: str) -> None:
        """A line to another network, `name` here and `eth0` there; addresses with their prefix."""
        self.ip(f"link add {name} type veth peer name eth0 netns {to.holder}")
        for network, device, address in ((self, name, own), (to, "eth0", far)):
            network.ip(f"address add {address} dev {device}")
            network.ip(f"link set {device} up")

    def end(self) -> None:
        """It is gone once nothing runs in it."""
        self._holder.kill()
        self._holder.wait()


@contextmanager
def networks(count: int) -> Iterator[list[Network]]:
    """So many, of one owner; skips where this machine allows none."""
    made: list[Network] = []
    unshare = program("unshare")
    try:
        for _ in range(count):
            alone = [unshare, "--net", "sleep", "infinity"]
            if not made:
                alone[1:1] = ["--user", "--map-root-user"]
            command = made[0].command(*alone) if made else alone
            holder = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
            made.append(Network(holder))
            _wait_until_it_sleeps(holder)
            made[-1].ip("link set lo up")
        yield made
    finally:
        for one in reversed(made):
            one.end()


def _wait_until_it_sleeps(holder: subprocess.Popen[str]) -> None:
    give_up = time.monotonic() + _PATIENCE_S
    while os.path.basename(os.readlink(f"/proc/{holder.pid}/exe")) not in ("sleep", "coreutils"):
        if holder.poll() is not None:
            assert holder.stderr is not None
            unavailable(f"no networks of its own: {holder.stderr.read().strip()}")
        assert time.monotonic() < give_up, "no network came about"
        time.sleep(0.01)
