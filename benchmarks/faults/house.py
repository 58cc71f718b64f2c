"""A whole service in processes of this machine that can be killed one by one.

Deployed, it is what docker-compose.yml runs: a gateway and a worker over PostgreSQL, Redis and an
S3 store, the last behind a line that can be cut. Else it has a database and a store in files.
"""

from __future__ import annotations

import secrets
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

from benchmarks.faults.cut_line import CutLine, cut_line
from benchmarks.faults.disks import TinyDisk
from benchmarks.load.host import Host
from benchmarks.servers import (
    METANERF,
    MortalObjects,
    MortalPostgres,
    MortalRedis,
    MortalServer,
    free_port,
    gateway_at,
)
from services.container import Services

ACCOUNT = "house"
DISK_BYTES = 256 << 20


@dataclass(frozen=True)
class House:
    """The parts of a service that runs."""

    host: Host
    services: Services
    """Over the same stores, for looking into them."""
    gateway: MortalServer
    spare: MortalServer
    """A second gateway, which does not run unless it is started."""
    spare_address: str
    worker: MortalServer
    redis: MortalRedis | None = None
    postgres: MortalPostgres | None = None
    objects: CutLine | None = None
    disk: TinyDisk | None = None
    """Where uploads and jobs keep what is not finished."""

    def start_gateways(self) -> None:
        """Have both gateways run."""
        for one in (self.gateway, self.spare):
            if not one.runs:
                one.start()

    def home_of(self, meeting_id: str) -> MortalServer:
        """The gateway that a meeting lives on."""
        with self.services.reading() as unit:
            home_id = unit.meetings.get(meeting_id).home_id
            living = unit.gateways.renewed_since(self.services.clock() - timedelta(minutes=1))
        (url,) = (one.url for one in living if one.id == home_id)
        return {self.host.address: self.gateway, self.spare_address: self.spare}[url]

    @property
    def header(self) -> dict[str, str]:
        """Of a caller of its account."""
        return {"Authorization": f"Bearer {self.host.token}"}


@contextmanager
def a_house(*, deployed: bool) -> Iterator[House]:
    """A service that runs, with one model in it; `deployed` as root alone, who may mount a disk.

    Raises InvalidInput where a server's program is not installed.
    """
    from services.auth import ALL_SCOPES
    from services.bootstrap import DEMO_MODEL, import_model
    from services.composition import build_services
    from services.settings import load_settings

    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.chmod(0o755)  # PostgreSQL's own user must reach its rows
        parts = _stores(folder, stack) if deployed else {}
        port = free_port()
        settings = load_settings(
            data_dir=folder / "data",
            port=port,
            jwt_secret=secrets.token_hex(32),
            open_access=False,
            embedded_worker=False,
            max_viewers=32,
            renderers="processes",
            renderer_viewers=32,
            client_dir=folder / "no-page",
            **_addresses(parts),
        )
        services = build_services(settings)
        stack.callback(services.close)
        services.database.migrate()
        if deployed:
            parts["disk"] = TinyDisk(settings.folders.scratch_dir, DISK_BYTES)
            stack.callback(parts["disk"].remove)
        model = import_model(services, DEMO_MODEL, ACCOUNT, "Ada")
        token, _ = services.tokens.issue(ACCOUNT, ALL_SCOPES, timedelta(hours=2))
        address, environment = f"http://127.0.0.1:{port}", settings.child_environment()
        gateway = gateway_at(address, environment)
        spare_address = f"http://127.0.0.1:{free_port()}"
        spare = gateway_at(spare_address, environment)
        worker = MortalServer([*METANERF, "worker", "train"], lambda: True, environment=environment)
        for one in (gateway, spare, worker):
            stack.callback(one.kill)
        gateway.start()
        worker.start()
        host = Host(address, token, model.id)
        yield House(host, services, gateway, spare, spare_address, worker, **parts)


def _stores(folder: Path, stack: ExitStack) -> dict[str, Any]:
    objects = MortalObjects()
    parts: dict[str, Any] = {
        "redis": MortalRedis(),
        "postgres": MortalPostgres(folder / "postgres"),
    }
    for one in (objects, *parts.values()):
        stack.callback(one.kill)
        one.start()
    return {**parts, "objects": stack.enter_context(cut_line(objects.port))}


def _addresses(parts: dict[str, Any]) -> dict[str, str]:
    if not parts:
        return {}
    return {
        "database_url": parts["postgres"].url,
        "redis_url": parts["redis"].url,
        "object_store_url": "s3://test",
        "s3_endpoint_url": parts["objects"].address.rstrip("/"),
        "s3_access_key_id": "nobody",
        "s3_secret_access_key": secrets.token_hex(16),
    }
