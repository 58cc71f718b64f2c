"""Pictures come from a gateway in Docker's network to a browser that reaches the machine alone.

Three networks: the containers', where a gateway has the address that docker-compose.yml gives it;
the machine's own, with its proxy and its relay; and one outside, which has no way to a container.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from datetime import timedelta
from pathlib import Path

import pytest

from services.auth import ALL_SCOPES
from services.bootstrap import import_model
from services.composition import build_services
from services.settings import load_settings
from tests.deploy.composed import Stores, compose, gateways, make_secrets
from tests.deploy.namespaces import Network, networks
from tests.deploy.proxied import proxy_command
from tests.deploy.relayed import relay_command

pytestmark = pytest.mark.server
MACHINE, OUTSIDE = "192.0.2.1", "192.0.2.2"
NAME = gateways()[0]
CONNECT = "import socket, sys; socket.create_connection((sys.argv[1], 8000), timeout=5)"


@pytest.fixture
def apart() -> Iterator[tuple[Network, Network, Network]]:
    """The machine's, the containers' and the one outside."""
    own = compose()["services"][NAME]["networks"]["default"]["ipv4_address"]
    with networks(3) as (machine, containers, outside):
        machine.lay_line("bridge", "172.30.77.1/24", containers, f"{own}/24")
        machine.lay_line("world", f"{MACHINE}/24", outside, f"{OUTSIDE}/24")
        containers.ip(f"route add {MACHINE} via 172.30.77.1")
        yield machine, containers, outside


def test_a_picture_comes_by_each_way_to_the_relay_and_by_no_other(
    apart: tuple[Network, Network, Network], tmp_path: Path, model_file: Path
):
    machine, containers, outside = apart
    make_secrets(tmp_path)
    service = compose()["services"][NAME]
    settings = own_environment(service, tmp_path)
    token, model_id = with_a_model(settings, model_file)
    address = service["networks"]["default"]["ipv4_address"]
    proxy = tmp_path / "proxy"
    proxy.mkdir()
    main = [sys.executable, "-c", "from services.cli import main; main()"]
    own = {"HOME": str(tmp_path), "XDG_DATA_HOME": str(proxy), "DOMAIN": "localhost"}
    proxied = proxy_command(tmp_path, dict.fromkeys(gateways(), f"{address}:8000"))
    with ExitStack() as stack:
        for command, environment in (
            (containers.command(*main, *service["command"][1:]), settings),
            (machine.command(*proxied), own),
            (machine.command(*relay_command(tmp_path, {})), os.environ | own),
        ):
            running = subprocess.Popen(
                command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            stack.callback(running.wait)
            stack.callback(running.terminate)
        root = proxy / "caddy/pki/authorities/local/root.crt"
        far = outside.command(sys.executable, "-m", "tests.deploy.far_viewer", MACHINE)
        done = subprocess.run(
            [*far, token, model_id],
            env=os.environ | {"SSL_CERT_FILE": str(root)},
            stdout=subprocess.PIPE,
            timeout=120,
        )
        straight = outside.command(sys.executable, "-c", CONNECT, address)
        no_way = subprocess.run(straight, capture_output=True, text=True)
    assert "Network is unreachable" in no_way.stderr
    seen = json.loads(done.stdout)
    assert list(seen) == json.loads(settings["METANERF_TURN_URLS"])
    assert all(variety > 5 for variety in seen.values()), seen


def own_environment(service: dict, folder: Path) -> dict[str, str]:
    """The gateway's, with a file and a folder as its stores, since it reaches no server here."""
    given = Stores(folder, "", "").environment(service, 8000)
    for name in ("METANERF_DATABASE_URL_FILE", "METANERF_REDIS_URL", "METANERF_S3_ENDPOINT_URL"):
        given.pop(name)
    return given | {
        "METANERF_OBJECT_STORE_URL": f"file://{folder}/objects",
        "METANERF_HOST": "0.0.0.0",
    }


def with_a_model(environment: dict[str, str], model_file: Path) -> tuple[str, str]:
    """The token of somebody who has a model, and its id."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in environment.items():
            if name.startswith("METANERF_"):
                patch.setenv(name, value)
        services = build_services(load_settings())
    try:
        services.database.migrate()
        token, _ = services.tokens.issue("house", ALL_SCOPES, timedelta(hours=1))
        return token, import_model(services, model_file, "house", "Ada").id
    finally:
        services.close()
