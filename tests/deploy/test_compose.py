"""docker-compose.yml: valid by the specification, and each of our services' own commands works.

How the services work together: test_running.py.
"""

from __future__ import annotations

import ipaddress
import json
import os
import re
import signal
import socket
import ssl
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path

import jsonschema
import jwt
import pytest

from services.settings import load_settings
from tests.deploy.composed import ROOT, Stores, compose, gateways, make_secrets
from tests.deploy.relayed import relay_command
from tests.servers import free_port, self_signed
from tests.services.jobs.waiting import until

SCHEMA = files("check_jsonschema") / "builtin_schemas" / "vendor" / "compose-spec.json"
OURS = (*gateways(), "capture", "worker")
LOAD = ROOT / "docs" / "load.md"
AS_THEY_ARE = {"objects", "bucket"}
"""Images of others without a user of their own."""


def test_it_is_valid_by_the_compose_specification():
    jsonschema.validate(compose(), json.loads(SCHEMA.read_text()))


def test_every_dependency_is_a_service_with_a_health_check():
    services = compose()["services"]
    for name, service in services.items():
        for needed, how in (service.get("depends_on") or {}).items():
            assert needed in services, name
            if how["condition"] == "service_healthy":
                assert "healthcheck" in services[needed], needed


def test_whatever_answers_to_a_port_has_a_health_check():
    services = compose()["services"]
    works = {"capture", "worker", "worker-gpu", "bucket"}
    assert {name for name, one in services.items() if "healthcheck" not in one} == works


def test_nobody_needs_redis_to_start():
    for name, service in compose()["services"].items():
        condition = service.get("depends_on", {}).get("redis", {}).get("condition")
        assert condition in (None, "service_started"), name


def test_models_are_trained_by_the_profile_that_is_chosen():
    services = compose()["services"]
    assert (services["worker"]["profiles"], services["worker-gpu"]["profiles"]) == (
        ["cpu"],
        ["gpu"],
    )
    assert services["worker"]["command"] == services["worker-gpu"]["command"]
    always = {name for name, one in services.items() if "profiles" not in one}
    assert always >= {"proxy", *gateways(), "capture", "turn", "postgres", "redis", "objects"}


def test_images_are_exact_and_services_have_bounds():
    for name, service in compose()["services"].items():
        assert re.search(r":(RELEASE\.)?v?\d+[.-]\d+[.-]\d", service["image"] + ".0"), name
        limits = service["deploy"]["resources"]["limits"]
        assert {"memory", "pids"} <= set(limits), name
    bases = re.findall(r"^FROM (\S+)", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    assert all(re.search(r":\d+\.\d+\.\d+|^metanerf$", base) for base in bases), bases


def test_services_may_do_no_more_than_they_have_to():
    for name, service in compose()["services"].items():
        if name in AS_THEY_ARE:
            continue
        assert service["read_only"], name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert service.get("user") != "root", name
    stages = re.split(r"^FROM ", (ROOT / "Dockerfile").read_text(), flags=re.MULTILINE)[1:]
    for stage in stages:
        users = re.findall(r"^USER (\S+)", stage, re.MULTILINE)
        assert users[-1:] != ["root"], stage
        if re.search(r"AS (proxy|metanerf)\n", stage):
            assert users, stage


def test_secrets_are_files_that_are_made_once(tmp_path: Path):
    made = make_secrets(tmp_path)
    assert oct(made.stat().st_mode)[-3:] == "700"
    document = compose()
    assert {f"./secrets/{one.name}" for one in made.iterdir()} == {
        secret["file"] for secret in document["secrets"].values()
    }
    for service in document["services"].values():
        assert set(service.get("secrets", ())) <= set(document["secrets"])
    before = {one.name: one.read_text() for one in made.iterdir()}
    # these come from elsewhere, or later
    assert {name for name, one in before.items() if not one} == {
        "oidc_client_secret",
        "jwt_other_secrets",
    }
    given = [one for one in before.values() if one]
    assert len(set(given)) == len(given)
    assert before["postgres_password"] in before["database_url"]
    make_secrets(tmp_path)
    assert {one.name: one.read_text() for one in made.iterdir()} == before
    # none is in the file itself, nor in what is committed or sent to the image's builder
    text = (ROOT / "docker-compose.yml").read_text()
    assert not re.search(r"(?i)(password|secret|token)(_KEY)?: (?!/run/secrets/)[\"$\w]", text)
    assert "/secrets/" in (ROOT / ".gitignore").read_text()
    assert "secrets" in (ROOT / ".dockerignore").read_text().split()


def test_what_a_gateway_signed_before_holds_once_the_secret_is_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = make_secrets(tmp_path)
    stores = Stores(tmp_path, "redis://127.0.0.1", "http://127.0.0.1")
    gateway = compose()["services"][gateways()[0]]
    for name, value in stores.environment(gateway, 0).items():
        if name.startswith("METANERF_"):
            monkeypatch.setenv(name, value)
    before = load_settings()
    assert before.security.other_jwt_secrets == []
    token = before.signing_keys().sign({"sub": "ada"})
    previous = (folder / "jwt_secret").read_text()
    (folder / "jwt_secret").write_text(previous[::-1])
    with pytest.raises(jwt.InvalidSignatureError):
        load_settings().signing_keys().read(token)
    (folder / "jwt_other_secrets").write_text(f"{previous}\n")
    assert load_settings().signing_keys().read(token) == {"sub": "ada"}


def test_every_process_of_ours_says_in_its_lines_which_it_is():
    for name, service in compose()["services"].items():
        if "METANERF_ENVIRONMENT" in service.get("environment", {}):
            assert service["environment"]["METANERF_LOG_FORMAT"] == "json"
            assert service["environment"]["METANERF_NODE_ID"] == name


def test_a_gateway_takes_as_many_as_it_was_measured_to_hold():
    measured = re.search(
        r"Largest number that holds: \*\*(\d+)\*\* meetings of (\d+)", LOAD.read_text()
    )
    assert measured is not None
    meetings, people = map(int, measured.groups())
    [taken] = {
        compose()["services"][name]["environment"]["METANERF_MAX_VIEWERS"] for name in gateways()
    }
    assert int(taken) <= meetings * people
    # the same in .env, and on Kubernetes
    assert f"MAX_VIEWERS={taken}\n" in (ROOT / "scripts/secrets.sh").read_text()
    manifest = (ROOT / "deploy/kubernetes/base/gateway.yaml").read_text()
    assert f'METANERF_MAX_VIEWERS, value: "{taken}"' in manifest


def test_what_is_mounted_is_there():
    for name, service in compose()["services"].items():
        for volume in service.get("volumes", ()):
            source = volume.split(":")[0]
            if source.startswith("."):
                assert (ROOT / source).exists(), (name, source)


def test_each_gateway_has_what_is_its_own_and_the_rest_in_common():
    document, own = compose(DOMAIN="meet.example.org"), gateways()
    services = [document["services"][name] for name in own]
    assert len(services) >= 2
    for name, service in zip(own, services, strict=True):
        assert service["environment"].pop("METANERF_NODE_ID") == name
        url = service["environment"].pop("METANERF_GATEWAY_URL")
        assert url == f"https://{name}.meet.example.org"
        assert service.pop("volumes") == [f"{name}:/data"]
        assert document["services"]["proxy"]["depends_on"][name]["condition"] == "service_healthy"
    [network] = document["networks"]["default"]["ipam"]["config"]
    by_turns = ipaddress.ip_network(network["ip_range"])
    addresses = [
        ipaddress.ip_address(service.pop("networks")["default"]["ipv4_address"])
        for service in services
    ]
    assert len(set(addresses)) == len(own)
    for address in addresses:
        assert address in ipaddress.ip_network(network["subnet"])
        # or whatever starts first might be given it
        assert address not in by_turns
    assert all(service == services[0] for service in services)
    caddyfile = (ROOT / "deploy" / "Caddyfile").read_text()
    assert f"reverse_proxy {' '.join(f'{name}:8000' for name in own)} {{" in caddyfile
    for name in own:
        block = rf"^{name}\.{{\$DOMAIN:localhost}} {{[^}}]+ {name}:8000 {{"
        assert re.search(block, caddyfile, re.MULTILINE), name


def test_the_relay_reaches_the_gateways_and_nobody_else():
    services = compose()["services"]
    allowed = re.findall(
        r"^allowed-peer-ip=(\S+)", (ROOT / "deploy/turnserver.conf").read_text(), re.MULTILINE
    )
    assert allowed == [services[name]["networks"]["default"]["ipv4_address"] for name in gateways()]


@dataclass(frozen=True)
class Relay:
    """The service `turn` by its own command, below a folder."""

    folder: Path
    port: int
    tls_port: int
    process: subprocess.Popen[bytes]

    def give_certificate(self, name: str) -> bytes:
        """Put one where the proxy keeps those that `name` gave it; in DER."""
        at = self.folder / "proxy/caddy/certificates" / name / "localhost"
        at.mkdir(parents=True)
        made = self_signed("localhost")
        (at / "localhost.key").write_bytes(made.key)
        (at / "localhost.crt").write_bytes(made.certificate)
        return ssl.PEM_cert_to_DER_cert(made.certificate.decode())

    def certificate(self) -> bytes | None:
        """What it shows to whoever comes by TLS, in DER."""
        trusting = ssl.create_default_context()
        trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
        try:
            with (
                socket.create_connection(("127.0.0.1", self.tls_port), timeout=2) as line,
                trusting.wrap_socket(line) as secured,
            ):
                return secured.getpeercert(binary_form=True)
        except OSError:
            return None


@pytest.fixture
def relay(tmp_path: Path) -> Iterator[Relay]:
    service, port, tls_port = compose()["services"]["turn"], free_port(), free_port()
    make_secrets(tmp_path)
    process = subprocess.Popen(
        relay_command(tmp_path, {3478: port, 5349: tls_port}),
        env=os.environ | service["environment"],
        stdout=subprocess.DEVNULL,
    )
    check = [*service["healthcheck"]["test"][1:]]
    check[check.index("3478")] = str(port)
    try:
        until(partial(passes, check), "a relay that is up")
        yield Relay(tmp_path, port, tls_port, process)
    finally:
        process.terminate()
        # coturn ends by itself, or where it has just begun by the signal
        assert process.wait(timeout=10) in (0, 128 + signal.SIGTERM)
    assert not passes(check), "the relay outlived its service"


@pytest.mark.server
def test_the_relay_starts_with_its_own_command_and_hides_its_secret(relay: Relay):
    secret = (relay.folder / "secrets" / "turn_secret").read_text()
    shown = [
        path.read_text()
        for path in Path("/proc").glob("[0-9]*/cmdline")
        if str(relay.folder) in readable(path)
    ]
    assert any("turnserver\0" in one for one in shown)
    assert not any(secret in one for one in shown)


@pytest.mark.server
def test_the_relay_speaks_tls_by_the_proxys_certificate_once_there_is_one(relay: Relay):
    assert relay.certificate() is None
    first = relay.give_certificate("an-authority")
    until(lambda: relay.certificate() == first, "TLS")
    # renewed, by another authority
    second = relay.give_certificate("the-next")
    started = (relay.folder / "tmp" / "turnserver.pid").stat()
    until(lambda: relay.certificate() == second, "the next certificate")
    assert (relay.folder / "tmp" / "turnserver.pid").stat() == started


def test_browsers_are_told_of_each_way_to_the_relay():
    services = compose(DOMAIN="meet.example.org")["services"]
    settings = (ROOT / "deploy/turnserver.conf").read_text().splitlines()
    for name in gateways():
        assert json.loads(services[name]["environment"]["METANERF_TURN_URLS"]) == [
            "turn:meet.example.org:3478?transport=udp",
            "turn:meet.example.org:3478?transport=tcp",
            "turns:meet.example.org:5349?transport=tcp",
        ]
    assert {"listening-port=3478", "tls-listening-port=5349"} <= set(settings)


def test_the_relay_reads_the_proxys_certificate_as_the_same_user():
    service = compose()["services"]["turn"]
    assert "proxy:/proxy:ro" in service["volumes"]
    user = re.search(r"adduser .* -u (\d+) proxy\b", (ROOT / "Dockerfile").read_text())
    assert user is not None
    assert service["user"] == f"{user[1]}:{user[1]}"


def readable(path: Path) -> str:
    """The text of a file of /proc; nothing of a process that has ended."""
    try:
        return path.read_text()
    except OSError:
        return ""


def passes(health_check: list[str]) -> bool:
    """Whether a check succeeds; one that hangs is stopped, as an engine does."""
    try:
        return subprocess.run(health_check, capture_output=True, timeout=1).returncode == 0
    except subprocess.TimeoutExpired:
        return False
