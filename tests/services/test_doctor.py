"""The doctor finds what is there, and what is not it names with how to mend it."""

from __future__ import annotations

import socket
import sys
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr

from services import settings
from services.cli.app import app
from services.container import Services
from services.doctor import Finding, examine
from services.settings import Settings
from tests.servers import TurnServer, free_port
from tests.services.cli.test_commands import runner
from tests.services.conftest import changed


@pytest.fixture
def equipped(services: Services, tmp_path: Path) -> Settings:
    """Settings of which this machine has everything."""
    page = tmp_path / "page"
    page.mkdir()
    (page / "index.html").touch()
    network = tmp_path / "a.task"
    network.touch()
    models = {f"{name}_model": network for name in ("pose", "face", "hand")}
    return changed(services.settings, port=free_port(), client_dir=page, **models)


def advised(settings: Settings, **values: Any) -> dict[str, Finding]:
    """What the doctor would have mended, by what it is."""
    found = examine(changed(settings, **values))
    return {one.what: one for one in found if one.advice and one.what != "cores"}


@pytest.mark.server
def test_a_machine_that_has_everything_needs_no_advice(equipped: Settings, turn_server: TurnServer):
    relay = {"turn_urls": [turn_server.url], "turn_secret": SecretStr(turn_server.secret)}
    assert advised(equipped, **relay) == {}
    # the same relay with another secret gives nothing
    relay["turn_secret"] = SecretStr("another")
    [finding] = advised(equipped, **relay).values()
    assert (finding.what, finding.found) == (f"relay {turn_server.url}", "gives no relay")
    assert "METANERF_TURN_SECRET" in finding.advice


def test_what_is_missing_is_named_with_how_to_mend_it(equipped: Settings, tmp_path: Path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        found = advised(
            equipped,
            port=other.getsockname()[1],
            redis_url="redis://127.0.0.1:1/0",
            database_url="postgresql+psycopg://nobody@127.0.0.1:1/none",
            client_dir=tmp_path / "no-page",
            hand_model=tmp_path / "no.task",
        )
    assert {what: one.advice.split()[-1] for what, one in found.items()} == {
        "database": "METANERF_DATABASE_URL",
        "redis": "METANERF_REDIS_URL",
        "port": "METANERF_PORT",
        "hand model": "fetched",
        "page": "scripts/setup.sh",
    }


@pytest.mark.parametrize(
    ("trial", "found"),
    [
        ("""echo '{"files": false, "sockets": true}'""", "a hostile clip would reach files"),
        ("""echo '{"files": false, "sockets": false}'""", "would reach files and sockets"),
        ("echo 'no such module' >&2; exit 1", "no such module"),
    ],
)
def test_a_machine_that_holds_nothing_back_is_told(
    equipped: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trial: str, found: str
):
    program = tmp_path / "tries"
    program.write_text(f"#!/bin/sh\n{trial}\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))
    [finding] = advised(equipped).values()
    assert finding.what == "confinement"
    assert found in finding.found


def test_the_command_says_all_and_ends_with_1(
    equipped: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(settings, "load_settings", lambda: equipped)
    done = runner.invoke(app, ["doctor"])
    assert "H264 encoder" in done.output
    assert done.exit_code == (1 if "give it 2 or more" in done.output else 0)
    (equipped.server.client_dir / "index.html").unlink()
    done = runner.invoke(app, ["doctor"])
    assert done.exit_code == 1
    assert "build it" in done.output
