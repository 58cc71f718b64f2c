"""docker-compose.yml: valid by the specification, and each of our services' own commands works.

No container engine is needed: the commands run here, with the file's own environment, against a
local PostgreSQL and Redis in place of those of the file. The S3 store is replaced by a folder.
"""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from db.models import JobKind, PersonRow, SequenceKind, SequenceRow, SequenceState, new_id
from services.composition import build_services
from services.container import Services
from services.jobs.queue import enqueue
from services.settings import load_settings
from tests.services.jobs.waiting import until

ROOT = Path(__file__).resolve().parents[1]
SCHEMA = files("check_jsonschema") / "builtin_schemas" / "vendor" / "compose-spec.json"
OURS = ("gateway", "capture", "worker")
VARIABLES = {"JWT_SECRET": "kq8Zr2mW" * 6, "POSTGRES_PASSWORD": "p" * 24, "S3_SECRET": "s" * 24}


def compose() -> dict[str, Any]:
    """The file with its variables put in, as the engine would."""
    text = (ROOT / "docker-compose.yml").read_text()

    def value(found: re.Match[str]) -> str:
        name, default = found[1], found[3]
        return VARIABLES.get(name, default if found[2] == ":-" else "")

    filled = re.sub(r"(?<!\$)\$\{(\w+)(?:(:-|:\?)([^}]*))?\}", value, text)
    return yaml.safe_load(filled)


def test_it_is_valid_by_the_compose_specification():
    jsonschema.validate(compose(), json.loads(SCHEMA.read_text()))


def test_secrets_must_be_given():
    text = (ROOT / "docker-compose.yml").read_text()
    for name in VARIABLES:
        assert re.search(rf"\$\{{{name}:\?", text), name


def test_every_dependency_is_a_service_with_a_health_check():
    services = compose()["services"]
    for name, service in services.items():
        for needed, how in (service.get("depends_on") or {}).items():
            assert needed in services, name
            if how["condition"] == "service_healthy":
                assert "healthcheck" in services[needed], needed


def environment(
    service: dict[str, Any], folder: Path, port: int, stores: dict[str, str]
) -> dict[str, str]:
    given = {k: str(v) for k, v in service["environment"].items()}
    return {
        **{k: v for k, v in os.environ.items() if not k.startswith("METANERF_")},
        **given,
        **stores,
        "METANERF_OBJECT_STORE_URL": f"file://{folder}/objects",
        "METANERF_DATA_DIR": str(folder / "data"),
        "METANERF_PORT": str(port),
    }


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_each_service_starts_with_its_own_command_and_environment(
    tmp_path: Path, postgres_url: str, redis_url: str
):
    stores = {"METANERF_DATABASE_URL": postgres_url, "METANERF_REDIS_URL": redis_url}
    services, port = compose()["services"], free_port()
    main = [sys.executable, "-c", "from services.cli import main; main()"]
    running = {
        name: subprocess.Popen(
            [*main, *services[name]["command"][1:]],
            env=environment(services[name], tmp_path, port, stores),
            stderr=subprocess.PIPE,
            text=True,
        )
        for name in OURS
    }
    try:
        checks = wait_ready(f"http://127.0.0.1:{port}/readyz", seconds=60)
        assert checks == {"database": "ok", "objects": "ok", "redis": "ok"}
        with one_job_of_each_kind(stores, tmp_path) as jobs:
            takers = {
                kind: until(partial(jobs.taker, kind), f"taking a {kind}") for kind in JobKind
            }
        assert takers == {
            JobKind.CAPTURE: running["capture"].pid,
            JobKind.TRAIN: running["worker"].pid,
            JobKind.EXPORT: running["worker"].pid,
        }
        assert {name: process.poll() for name, process in running.items()} == dict.fromkeys(OURS)
    finally:
        for process in running.values():
            process.send_signal(signal.SIGTERM)
        told = {name: process.communicate(timeout=30)[1] for name, process in running.items()}
    for name, process in running.items():
        assert process.returncode in (0, -signal.SIGTERM), told[name]


@dataclass
class Jobs:
    """Jobs that no child can do, for want of a clip: enough to see who takes them."""

    services: Services
    ids: dict[JobKind, str]

    def taker(self, kind: JobKind) -> int | None:
        """The id of the process that has taken the job of this kind; None: it waits."""
        with self.services.reading() as unit:
            worker = unit.jobs.get(self.ids[kind]).worker
        return None if worker is None else int(worker.rpartition(":")[2])


@contextmanager
def one_job_of_each_kind(stores: dict[str, str], folder: Path) -> Iterator[Jobs]:
    services = build_services(
        load_settings(
            data_dir=folder / "test",
            object_store_url=f"file://{folder}/objects",
            database_url=stores["METANERF_DATABASE_URL"],
            redis_url=stores["METANERF_REDIS_URL"],
        )
    )
    ids: dict[JobKind, str] = {}
    with services.unit_of_work() as unit:
        now = services.clock()
        ada = PersonRow(id=new_id(), account="house", name="Ada", created_at=now)
        unit.people.add(ada)
        unit.flush()
        for number, kind in enumerate(JobKind):
            clip = SequenceRow(
                id=new_id(),
                person_id=ada.id,
                kind=SequenceKind.VIDEO,
                state=SequenceState.UPLOADED,
                created_at=now,
                source_name="none.mp4",
                source_sha256=f"{number:064x}",
            )
            unit.sequences.add(clip)
            unit.flush()
            ids[kind] = enqueue(unit, kind, clip, {}, now).id
        unit.commit()
    try:
        yield Jobs(services, ids)
    finally:
        services.close()


def wait_ready(address: str, seconds: float) -> dict[str, str]:
    give_up = time.monotonic() + seconds
    while time.monotonic() < give_up:
        try:
            with urllib.request.urlopen(address, timeout=2) as answer:
                return json.load(answer)["checks"]
        except (urllib.error.URLError, OSError):
            time.sleep(0.3)
    pytest.fail(f"{address} was not ready in {seconds} s")
