"""The services of docker-compose.yml at work together, each by its own command and environment.

No container engine is needed: they run here, with the file's secrets, against a local PostgreSQL,
Redis and S3 store in place of those of the file, behind its proxy, and watched by its Prometheus.
"""

from __future__ import annotations

import asyncio
import json
import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import httpx
import pytest
import yaml

from db.models import JobKind, SequenceState
from services.composition import build_services
from services.container import Services
from services.jobs.queue import enqueue
from services.settings import load_settings
from tests.deploy.composed import ROOT, Stores, compose, gateways, wait_ready
from tests.deploy.proxied import Proxy, proxy_to
from tests.servers import free_port, fresh_database, program
from tests.services.control.page import Page
from tests.services.jobs.waiting import until
from tests.services.seeds import uploaded

pytestmark = pytest.mark.server
OURS = (*gateways(), "capture", "worker")
SDP = {"content-type": "application/sdp"}


@dataclass(frozen=True)
class Deployed:
    """Everything, as `docker compose up` would have it."""

    stores: Stores
    proxy: Proxy
    ports: dict[str, int]
    """Of gateways, and of workers' figures, by their names."""
    running: dict[str, subprocess.Popen[str]]

    def caller(self, url: str, token: str = "") -> httpx.AsyncClient:
        """Of an address of the proxy's."""
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        return httpx.AsyncClient(
            base_url=url, headers=headers, verify=self.proxy.trust(), timeout=30.0
        )


@pytest.fixture(scope="module")
def deployed(
    tmp_path_factory: pytest.TempPathFactory, redis_url: str, s3_endpoint: str
) -> Iterator[Deployed]:
    folder = tmp_path_factory.mktemp("deployed")
    with ExitStack() as stack:
        postgres_url = stack.enter_context(fresh_database("postgresql", folder))
        stores = Stores.of_this_machine(folder, postgres_url, redis_url, s3_endpoint)
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        https, ports = free_port(), {name: free_port() for name in OURS}
        services = compose(DOMAIN=f"localhost:{https}")["services"]
        running = {name: stores.start(services[name], ports[name]) for name in OURS}
        try:
            for name in gateways():
                ready = wait_ready(ports[name])
                assert ready == {"database": "ok", "objects": "ok", "redis": "ok"}
            with proxy_to(ports, folder, https, free_port(), patch) as proxy:
                yield Deployed(stores, proxy, ports, running)
            ended = {name: process.poll() for name, process in running.items()}
        finally:
            for process in running.values():
                process.send_signal(signal.SIGTERM)
            told = {name: process.communicate(timeout=60)[1] for name, process in running.items()}
        assert ended == dict.fromkeys(OURS), told
    for name, process in running.items():
        assert process.returncode in (0, -signal.SIGTERM), told[name]
        lines = [json.loads(line) for line in told[name].splitlines() if line.startswith("{")]
        assert lines or name in gateways(), told[name]
        assert {line["node_id"] for line in lines} <= {name}


def test_each_kind_of_job_is_taken_by_its_worker(deployed: Deployed):
    with one_job_of_each_kind(deployed.stores) as jobs:
        takers = {kind: until(partial(jobs.taker, kind), f"taking a {kind}") for kind in JobKind}
    by = {JobKind.CAPTURE: "capture", JobKind.TRAIN: "worker", JobKind.EXPORT: "worker"}
    assert takers == {kind: deployed.running[name].pid for kind, name in by.items()}
    address = f"http://127.0.0.1:{deployed.ports['capture']}/metrics"
    tried = r'job_attempt_seconds_count{kind="capture",outcome="\w+"} [1-9]'
    until(partial(found_in, address, tried), "the end of an attempt")
    assert found_in(address, 'metanerf_node_info{node_id="capture"} 1')


def found_in(address: str, pattern: str) -> bool:
    """Whether the figures there hold this."""
    return re.search(pattern, httpx.get(address).text) is not None


async def test_any_gateway_answers_and_sends_people_to_where_their_meeting_lives(
    deployed: Deployed,
):
    proxy = deployed.proxy
    urls = [proxy.url_of(name) for name in gateways()]
    async with deployed.caller(proxy.url) as anybody:
        token = (await anybody.post("/v1/guest")).json()["token"]
        meeting_id = (await made_by(anybody, token))["id"]
    seats = []
    for url in (proxy.url, *urls):
        async with deployed.caller(url, token) as caller:
            path = f"/v1/meetings/{meeting_id}"
            assert (await caller.get(path)).json()["name"] == "Monday"
            seats.append((await caller.post(f"{path}/join", json={})).json())
            assert (await caller.get("/metrics")).status_code == 404
    [home] = {seat["gateway_url"] for seat in seats}
    [other] = set(urls) - {home}
    path = f"/v1/meetings/{meeting_id}/voice"
    async with deployed.caller(other, seats[0]["token"]) as caller:
        sent = await caller.post(path, content=b"v=0", headers=SDP)
        assert (sent.status_code, sent.headers["location"]) == (307, home + path)
    async with deployed.caller(home, seats[0]["token"]) as caller:
        here = await caller.post(path, content=b"v=0", headers=SDP)
        assert here.status_code == 422, here.text
    async with page_at(other, meeting_id, seats[0], "Ada") as lost:
        assert (await lost.gone())["reason"] == "moved"
    async with (
        page_at(home, meeting_id, seats[0], "Ada") as ada,
        page_at(home, meeting_id, seats[1], "Bo") as bo,
    ):
        for one in (ada, bo):
            await one.roster(lambda who: {"Ada", "Bo"} <= who.keys())


async def test_what_ends_is_left_out_and_its_meetings_go_on_at_the_other(deployed: Deployed):
    async with deployed.caller(deployed.proxy.url) as anybody:
        token = (await anybody.post("/v1/guest")).json()["token"]
        meeting_id = (await made_by(anybody, token))["id"]
    async with deployed.caller(deployed.proxy.url, token) as caller:

        async def home() -> str:
            found = await caller.get(f"/v1/meetings/{meeting_id}/home")
            assert found.status_code == 200, found.text
            return found.json()["gateway_url"]

        first = await home()
        [name] = [name for name in gateways() if deployed.proxy.url_of(name) == first]
        ending = deployed.running[name]
        ending.send_signal(signal.SIGTERM)
        while ending.poll() is None:
            await home()
            await asyncio.sleep(0.05)
        # whichever is asked first
        for _ in range(4 * len(gateways())):
            assert await home() != first
    service = compose(DOMAIN=deployed.proxy.domain)["services"][name]
    deployed.running[name] = deployed.stores.start(service, deployed.ports[name])
    await asyncio.to_thread(wait_ready, deployed.ports[name])


def test_prometheus_finds_each_gateway_and_worker(deployed: Deployed, tmp_path: Path):
    folder, port = ROOT / "deploy", free_port()
    text = (folder / "prometheus.yml").read_text()
    for name in gateways():
        text = text.replace(f"{name}:8000", f"127.0.0.1:{deployed.ports[name]}")
    configuration = yaml.safe_load(text.replace("15s", "1s"))
    # no names of a container engine's are known here
    workers = [f"127.0.0.1:{deployed.ports[name]}" for name in OURS if name not in gateways()]
    del configuration["scrape_configs"][1]["dns_sd_configs"]
    configuration["scrape_configs"][1]["static_configs"] = [{"targets": workers}]
    (tmp_path / "prometheus.yml").write_text(yaml.safe_dump(configuration))
    (tmp_path / "alerts.yml").write_text((folder / "alerts.yml").read_text())
    places = (("=/etc/prometheus/", f"={tmp_path}/"), ("=/prometheus", f"={tmp_path}/db"))
    words = compose()["services"]["prometheus"]["command"]
    for there, here in places:
        words = [word.replace(there, here) for word in words]
    words.append(f"--web.listen-address=127.0.0.1:{port}")
    process = subprocess.Popen([program("prometheus"), *words], stderr=subprocess.DEVNULL)

    def found() -> dict[str, str]:
        try:
            answer = httpx.get(f"http://127.0.0.1:{port}/api/v1/query", params={"query": "up"})
        except httpx.TransportError:
            return {}
        of = answer.json()["data"]["result"] if answer.is_success else []
        return {one["metric"]["instance"]: one["value"][1] for one in of}

    try:
        up = dict.fromkeys((f"127.0.0.1:{at}" for at in deployed.ports.values()), "1")
        until(lambda: found() == up, "figures of each")
    finally:
        process.terminate()
        process.wait()


async def made_by(caller: httpx.AsyncClient, token: str) -> dict:
    """A meeting of this account."""
    header = {"Authorization": f"Bearer {token}"}
    answer = await caller.post("/v1/meetings", json={"name": "Monday"}, headers=header)
    assert answer.status_code == 201, answer.text
    return answer.json()


def page_at(url: str, meeting_id: str, seat: dict, name: str) -> Page:
    """A page that takes this seat at this gateway."""
    channel = f"{url.replace('https', 'wss', 1)}/v1/meetings/{meeting_id}/control"
    return Page(channel, seat["token"], name)


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
def one_job_of_each_kind(stores: Stores) -> Iterator[Jobs]:
    services = build_services(
        load_settings(
            data_dir=stores.folder / "test",
            object_store_url="s3://metanerf",
            s3_endpoint_url=stores.s3_endpoint,
            s3_access_key_id="metanerf",
            s3_secret_access_key="any",
            database_url=(stores.folder / "secrets" / "database_url").read_text(),
            redis_url=stores.redis_url,
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
