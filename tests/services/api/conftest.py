"""A gateway whose database and store hold the whole world of the authorisation matrix."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from services.auth import Tokens
from services.composition import build_services
from services.container import Services
from services.settings import Settings, load_settings
from tests.fakes import Clock
from tests.services.api.authorisation_world import World, build
from tests.services.conftest import SECRET, changed


def _open(settings: Settings) -> Services:
    clock = Clock()
    services = build_services(settings, clock=clock)
    return replace(services, tokens=Tokens(settings.signing_keys(), clock))


@pytest.fixture(scope="session")
def world_folder(
    tmp_path_factory: pytest.TempPathFactory, empty_database: Path
) -> tuple[Path, World]:
    """A data folder with everything in it, to copy, and what it holds."""
    folder = tmp_path_factory.mktemp("world")
    services = _open(load_settings(data_dir=folder, jwt_secret=SECRET, open_access=True))
    shutil.copy(empty_database, folder / "metanerf.db")
    world = build(services)
    services.close()
    return folder, world


@pytest.fixture
def world(world_folder: tuple[Path, World]) -> World:
    """Who there is, and what they have."""
    return world_folder[1]


@pytest.fixture
def world_services(
    settings: Settings, world_folder: tuple[Path, World], tmp_path: Path
) -> Iterator[Services]:
    """Services over a copy of it, by a clock that stands still."""
    network = tmp_path / "network.task"
    network.write_bytes(b"a network")
    shutil.copytree(world_folder[0], settings.folders.data_dir, dirs_exist_ok=True)
    names = ("pose_model", "face_model", "hand_model")
    made = _open(changed(settings, **dict.fromkeys(names, network), max_view_px=64))
    yield made
    made.close()
