"""docker-compose.yml: valid by the specification, and each of our services' own commands works.

No container engine is needed: the commands run here, with the file's own environment and secrets,
against a local PostgreSQL and Redis in place of those of the file. The S3 store is a folder.
"""

from __future__ import annotations

import json
import re
import signal
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

import jsonschema
import jwt
import pytest

from db.models import JobKind, SequenceState
from services.composition import build_services
from services.container import Services
from services.jobs.queue import enqueue
from services.settings import load_settings
from tests.deploy.composed import ROOT, compose, environment, make_secrets
from tests.servers import free_port, program
from tests.services.jobs.waiting import until
from tests.services.seeds import uploaded

SCHEMA = files("check_jsonschema") / "builtin_schemas" / "vendor" / "compose-spec.json"
OURS = ("gateway", "capture", "worker")
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
    assert always >= {"proxy", "gateway", "capture", "turn", "postgres", "redis", "objects"}


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
    gateway = environment(compose()["services"]["gateway"], tmp_path, 0, "redis://127.0.0.1")
    for name, value in gateway.items():
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
    taken = compose()["services"]["gateway"]["environment"]["METANERF_MAX_VIEWERS"]
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


def test_the_relay_reaches_the_gateway_and_nobody_else():
    gateway = compose()["services"]["gateway"]
    allowed = re.findall(
        r"^allowed-peer-ip=(\S+)", (ROOT / "deploy/turnserver.conf").read_text(), re.MULTILINE
    )
    assert allowed == [gateway["networks"]["default"]["ipv4_address"]]


@pytest.mark.server
def test_the_relay_starts_with_its_own_command_and_hides_its_secret(tmp_path: Path):
    service, port = compose()["services"]["turn"], free_port()
    secret = (make_secrets(tmp_path) / "turn_secret").read_text()
    settings = (ROOT / "deploy/turnserver.conf").read_text()
    (tmp_path / "turnserver.conf").write_text(settings.replace("port=3478", f"port={port}"))
    (tmp_path / "tmp").mkdir()
    assert program("turnserver")
    command = service["command"][0].replace("$$", "$")
    for there, here in {
        "/etc/coturn": tmp_path,
        "/run/secrets": tmp_path / "secrets",
        "/tmp/turn": f"{tmp_path}/tmp/turn",
    }.items():
        command = re.sub(rf"(?<![\w.]){re.escape(there)}", str(here), command)
    relay = subprocess.Popen([*service["entrypoint"], command], stdout=subprocess.DEVNULL)
    check = [*service["healthcheck"]["test"][1:]]
    check[check.index("3478")] = str(port)
    try:
        until(partial(passes, check), "a relay that is up")
        shown = Path(f"/proc/{relay.pid}/cmdline").read_text()
        assert "turnserver" in shown
        assert secret not in shown
    finally:
        relay.kill()
        relay.wait()


def passes(health_check: list[str]) -> bool:
    """Whether a check succeeds; one that hangs is stopped, as an engine does."""
    try:
        return subprocess.run(health_check, capture_output=True, timeout=1).returncode == 0
    except subprocess.TimeoutExpired:
        return False


def test_each_service_starts_with_its_own_command_and_environment(
    tmp_path: Path, postgres_url: str, redis_url: str
):
    (make_secrets(tmp_path) / "database_url").write_text(postgres_url)
    services, port = compose()["services"], free_port()
    main = [sys.executable, "-c", "from services.cli import main; main()"]
    running = {
        name: subprocess.Popen(
            [*main, *services[name]["command"][1:]],
            env=environment(services[name], tmp_path, port, redis_url),
            stderr=subprocess.PIPE,
            text=True,
        )
        for name in OURS
    }
    try:
        checks = wait_ready(f"http://127.0.0.1:{port}/readyz", seconds=60)
        assert checks == {"database": "ok", "objects": "ok", "redis": "ok"}
        with one_job_of_each_kind(postgres_url, redis_url, tmp_path) as jobs:
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
        lines = [json.loads(line) for line in told[name].splitlines() if line.startswith("{")]
        assert lines or name == "gateway", told[name]
        assert {line["node_id"] for line in lines} <= {name}


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
def one_job_of_each_kind(database_url: str, redis_url: str, folder: Path) -> Iterator[Jobs]:
    services = build_services(
        load_settings(
            data_dir=folder / "test",
            object_store_url=f"file://{folder}/objects",
            database_url=database_url,
            redis_url=redis_url,
        )
    )
    # nobody takes a training whose clip is still to be captured; one that lacks its frames is tried
    # again, and the oldest job is taken first
    states = {
        JobKind.CAPTURE: SequenceState.UPLOADED,
        JobKind.EXPORT: SequenceState.UPLOADED,
        JobKind.TRAIN: SequenceState.READY,
    }
    clips = {kind: uploaded(services, state) for kind, state in states.items()}
    with services.unit_of_work() as unit:
        ids = {
            kind: enqueue(unit, kind, clip, {}, services.clock()).id for kind, clip in clips.items()
        }
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
