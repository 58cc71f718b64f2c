"""A gateway on a thread of the test's own, whose insides the test may look into."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

import uvicorn
from fastapi import FastAPI

from services.app import create_app
from services.auth import ALL_SCOPES
from services.composition import build_services
from services.container import Services
from services.settings import load_settings
from tests.services.jobs.waiting import until

WATCH = """
const make = RTCPeerConnection.prototype.createDataChannel;
RTCPeerConnection.prototype.createDataChannel = function (label, ...more) {
  if (label === "view") window.viewPeer = this;
  return make.call(this, label, ...more);
};
const send = RTCDataChannel.prototype.send;
RTCDataChannel.prototype.send = function (data) {
  if (this.label === "view") window.lastView = Array.from(new Uint8Array(data));
  return send.call(this, data);
};
"""
"""For a page: `lastView` is the viewpoint that it sent last, `viewPeer` the connection for it."""


@dataclass(frozen=True)
class Gateway:
    """A running gateway."""

    address: str
    app: FastAPI
    services: Services
    loop: asyncio.AbstractEventLoop

    def token(self, account: str) -> str:
        """What a page of this account is let in with."""
        return self.services.tokens.issue(account, ALL_SCOPES, timedelta(hours=1))[0]

    def do(self, work: Coroutine[Any, Any, object]) -> None:
        """Have `work` done on the gateway's own loop."""
        asyncio.run_coroutine_threadsafe(work, self.loop).result(30.0)


@contextmanager
def serving(data_dir: Path, **options: Any) -> Iterator[Gateway]:
    """A gateway on a free port; no job is worked on unless `options` say so."""
    options = {"open_access": True, "embedded_worker": False, **options}
    settings = load_settings(data_dir=data_dir, **options)
    services = build_services(settings)
    services.database.migrate()
    app = create_app(services)
    config = uvicorn.Config(app, port=0, log_level="warning", timeout_graceful_shutdown=3)
    server, loop = uvicorn.Server(config), asyncio.new_event_loop()
    thread = threading.Thread(target=lambda: loop.run_until_complete(server.serve()), daemon=True)
    thread.start()
    until(lambda: server.started, "starting the server")
    port = server.servers[0].sockets[0].getsockname()[1]
    try:
        yield Gateway(f"http://127.0.0.1:{port}/", app, services, loop)
    finally:
        server.should_exit = True
        thread.join(30.0)
