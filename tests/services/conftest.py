"""A gateway to test on: in this process (`client`), or as a server on a real port (`gateway`)."""

from __future__ import annotations

import dataclasses
import os
import shutil
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn

from services.app import create_app
from services.auth import ALL_SCOPES
from services.composition import build_services
from services.container import Services
from services.setting_groups import Group
from services.settings import Settings, load_settings
from tests.services import seeds

SECRET = "a key for tests only, long enough to sign"


Instead = Callable[[str], None]


@pytest.fixture
def instead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Instead:
    """Has a shell script run in the place of a confined process."""

    def set_up(script: str) -> None:
        program = tmp_path / "confined"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(program))

    return set_up


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return load_settings(
        data_dir=tmp_path / "data",
        jwt_secret=SECRET,
        open_access=True,
        embedded_worker=False,
        client_dir=tmp_path / "no-page",
        max_upload_bytes=20_000_000,
        job_niceness=0,  # other tests would starve the jobs
    )


@pytest.fixture
def changes() -> dict[str, int]:
    """Settings that a test wants otherwise in its gateway."""
    return {}


def changed(settings: Settings, **values: Any) -> Settings:
    """Settings in which `values` are others, by the names that load_settings takes; unchecked."""
    groups: dict[str, Group] = {}
    for field in dataclasses.fields(settings):
        group: Group = getattr(settings, field.name)
        names = {
            name: values.pop(variable)
            for name, one in type(group).model_fields.items()
            if (variable := str(one.validation_alias).removeprefix("METANERF_").lower()) in values
        }
        groups[field.name] = group.model_copy(update=names)
    assert not values, f"no settings: {values}"
    return Settings(**groups)  # pyright: ignore[reportArgumentType]


@pytest.fixture
def services(settings: Settings, empty_database: Path) -> Iterator[Services]:
    made = build_services(settings)
    shutil.copy(empty_database, settings.folders.data_dir / "metanerf.db")
    yield made
    made.close()


def bearer(
    services: Services, account: str = "house", scopes: frozenset[str] = ALL_SCOPES
) -> dict[str, str]:
    """The header of a caller."""
    token, _ = services.tokens.issue(account, scopes, timedelta(hours=1))
    return {"Authorization": f"Bearer {token}"}


def calling(services: Services) -> httpx.AsyncClient:
    """A caller of account `house`."""
    transport = httpx.ASGITransport(create_app(services), raise_app_exceptions=False)
    return httpx.AsyncClient(transport=transport, base_url="http://test", headers=bearer(services))


@pytest.fixture
async def client(services: Services) -> AsyncIterator[httpx.AsyncClient]:
    """See `calling`."""
    async with calling(services) as made:
        yield made


@pytest.fixture
async def person_id(client: httpx.AsyncClient) -> str:
    """Ada, of account `house`."""
    return (await client.post("/v1/people", json={"name": "Ada"})).json()["id"]


@pytest.fixture(scope="session")
def sequence_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small studio sequence."""
    return seeds.film(tmp_path_factory.mktemp("film") / "sequence")


@pytest.fixture(scope="session")
def model_file(tmp_path_factory: pytest.TempPathFactory, sequence_folder: Path) -> Path:
    """A model barely trained from it."""
    return seeds.train(sequence_folder, tmp_path_factory.mktemp("model") / "model.safetensors")


@contextmanager
def serving(settings: Settings) -> Iterator[httpx.Client]:
    """A real server on a free port, and a caller of account `house`."""
    services = build_services(settings)
    config = uvicorn.Config(
        create_app(services), port=0, log_level="warning", timeout_graceful_shutdown=3
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        assert thread.is_alive(), "the server did not start"
        time.sleep(0.02)
    port = server.servers[0].sockets[0].getsockname()[1]
    try:
        with httpx.Client(
            base_url=f"http://127.0.0.1:{port}", headers=bearer(services), timeout=60.0
        ) as caller:
            yield caller
    finally:
        server.should_exit = True
        thread.join(30.0)


def stored_files(settings: Settings) -> list[Path]:
    """Every file of the object store and of the scratch folder."""
    places = (settings.folders.data_dir / "objects", settings.folders.scratch_dir)
    # os.walk takes folders that vanish meanwhile calmly, which rglob does not
    found = [
        Path(at, name) for place in places for at, _, names in os.walk(place) for name in names
    ]
    return [path for path in found if path.is_file()]
