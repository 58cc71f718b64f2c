"""A line between a page's browser and the service that carries so much and drops the rest."""

from __future__ import annotations

import re
import selectors
import socket
import threading
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass

from playwright.sync_api import Page, Route

from benchmarks.faults.line import running

_MOST_BYTES = 65_536
_BURST_S = 0.25
"""What a line at rest carries at once, s of its rate."""
_CANDIDATE = re.compile(r"^a=candidate:.*\r\n", re.M)
_UDP = re.compile(r"^a=candidate:\S+ 1 udp \d+ (\d+\.\d+\.\d+\.\d+) (\d+) typ host", re.M)
Address = tuple[str, int]


@dataclass(eq=False)
class _Way:
    """One connection: the browser speaks to `near`, the service to `far`."""

    near: socket.socket
    far: socket.socket
    browser: Address | None = None
    service: Address | None = None


class SlowLine:
    """Carries the UDP of WebRTC connections; all of them share what the line carries."""

    def __init__(self) -> None:
        self.bit_per_s: float | None = None
        """Towards the page; None: everything gets through."""
        self.offered_bits = 0
        """What was to be carried towards the page so far, whether or not it got through."""
        self._waiting_bits, self._looked_s = 0.0, time.monotonic()
        self._ways = selectors.DefaultSelector()
        self._host = _own_address()
        self._over = threading.Event()

    def carry(self, page: Page) -> None:
        """Have the connections that `page` makes from now on go over this line."""
        for door in ("**/whep/*", "**/v1/meetings/*/voice"):
            page.route(door, self._let_in)

    def run(self) -> None:
        """Carry packets until `end`."""
        while not self._over.is_set():
            for key, _ in self._ways.select(0.1):
                way, from_browser = key.data
                data, sender = key.fileobj.recvfrom(_MOST_BYTES)  # type: ignore[union-attr]
                if from_browser:
                    way.browser = sender
                    if way.service is not None:
                        way.far.sendto(data, way.service)
                    continue
                self.offered_bits += 8 * len(data)
                if way.browser is not None and self._gets_through(8 * len(data)):
                    way.near.sendto(data, way.browser)

    def end(self) -> None:
        """Carry no more."""
        self._over.set()

    def _gets_through(self, bits: int) -> bool:
        rate, now_s = self.bit_per_s, time.monotonic()
        if rate is None:
            return True
        self._waiting_bits = max(0.0, self._waiting_bits - rate * (now_s - self._looked_s))
        self._looked_s = now_s
        if self._waiting_bits + bits > _BURST_S * rate:
            return False
        self._waiting_bits += bits
        return True

    def _let_in(self, route: Route) -> None:
        """The offer and the answer name this line's ends as the only addresses."""
        way = _Way(self._socket(), self._socket())
        self._ways.register(way.near, selectors.EVENT_READ, (way, True))
        self._ways.register(way.far, selectors.EVENT_READ, (way, False))
        answer = route.fetch(post_data=_reached_at(way.far, route.request.post_data or ""))
        sdp = answer.text()
        if found := _UDP.search(sdp):
            way.service = (found[1], int(found[2]))
            sdp = _reached_at(way.near, sdp)
        route.fulfill(response=answer, body=sdp)

    def _socket(self) -> socket.socket:
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.bind((self._host, 0))
        return made


def slow_line() -> AbstractContextManager[SlowLine]:
    """A line that runs on a thread of its own."""
    return running(SlowLine())


def _reached_at(end: socket.socket, sdp: str) -> str:
    """`sdp` with one candidate (RFC 8839), which is `end`."""
    host, port = end.getsockname()
    mine = f"a=candidate:1 1 udp 2130706431 {host} {port} typ host\r\n"
    sdp = _CANDIDATE.sub("", sdp)
    section = sdp.index("a=", sdp.index("m="))
    return sdp[:section] + mine + sdp[section:]


def _own_address() -> str:
    """Of this machine, by which browser and service reach each other."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # a datagram socket sends nothing by that
        return probe.getsockname()[0]
