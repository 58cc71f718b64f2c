"""Prometheus and Grafana: valid, about figures that exist, and each alarm sounds when it should."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from prometheus_client import REGISTRY

import services.jobs.worker
import services.live.look.receiver
import services.live.motion.driving_channels
import services.live.rendering.pool
import services.metrics  # noqa: F401  (registers its figures, as those above do)
from tests.deploy.composed import ROOT, compose, gateways
from tests.servers import program

DEPLOY = ROOT / "deploy"
DASHBOARD: dict[str, Any] = json.loads(
    (DEPLOY / "grafana" / "dashboards" / "metanerf.json").read_text()
)
RULES: list[dict[str, Any]] = yaml.safe_load((DEPLOY / "alerts.yml").read_text())["groups"][0][
    "rules"
]


@pytest.mark.server
def test_prometheus_takes_its_configuration_and_each_alarm_sounds(tmp_path: Path):
    promtool = program("promtool")
    shutil.copy(DEPLOY / "alerts.yml", tmp_path)
    shutil.copy(Path(__file__).with_name("alerts.test.yml"), tmp_path)
    for command in (
        ["check", "config", str(DEPLOY / "prometheus.yml")],
        ["test", "rules", str(tmp_path / "alerts.test.yml")],
    ):
        done = subprocess.run([promtool, *command], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr


def test_every_alarm_is_tried_out_and_explained():
    tried = Path(__file__).with_name("alerts.test.yml").read_text()
    explained = (ROOT / "docs" / "operate.md").read_text()
    for rule in RULES:
        assert re.search(rf"alertname: {rule['alert']}\n +exp_alerts", tried), rule["alert"]
        assert f"**{rule['alert']}**" in explained, rule["alert"]


def test_charts_and_alarms_are_about_figures_that_exist():
    known = {sample.name for family in REGISTRY.collect() for sample in family.samples}
    known |= {family.name for family in REGISTRY.collect()}
    known |= {f"{name}_{part}" for name in known for part in ("bucket", "count", "total")}
    charted = [target["expr"] for panel in DASHBOARD["panels"] for target in panel["targets"]]
    for expression in [*charted, *(rule["expr"] for rule in RULES)]:
        for name in re.findall(r"\bmetanerf_\w+", expression):
            assert name in known, expression


def test_no_panel_lies_on_another():
    taken: set[tuple[int, int]] = set()
    for panel in DASHBOARD["panels"]:
        at = panel["gridPos"]
        cells = {
            (x, y)
            for x in range(at["x"], at["x"] + at["w"])
            for y in range(at["y"], at["y"] + at["h"])
        }
        assert not cells & taken, panel["title"]
        taken |= cells
    assert len({panel["id"] for panel in DASHBOARD["panels"]}) == len(DASHBOARD["panels"])


def test_grafana_finds_prometheus_and_the_dashboard():
    provisioned = DEPLOY / "grafana" / "provisioning"
    [source] = yaml.safe_load((provisioned / "datasources" / "prometheus.yml").read_text())[
        "datasources"
    ]
    asked = {panel["datasource"]["uid"] for panel in DASHBOARD["panels"]}
    assert asked == {source["uid"]}
    services = compose()["services"]
    host, _, port = source["url"].removeprefix("http://").partition(":")
    assert f":{port}/" in services[host]["healthcheck"]["test"][-1]
    [provider] = yaml.safe_load((provisioned / "dashboards" / "metanerf.yml").read_text())[
        "providers"
    ]
    mounted = {one.split(":")[1] for one in services["grafana"]["volumes"]}
    assert provider["options"]["path"] in mounted
    assert {services[name]["profiles"][0] for name in ("prometheus", "grafana")} == {"observe"}


def test_prometheus_asks_each_gateway_and_worker_itself():
    scraped = yaml.safe_load((DEPLOY / "prometheus.yml").read_text())["scrape_configs"]
    assert [one["job_name"] for one in scraped] == ["gateway", "worker"]
    [by_name] = scraped[1]["dns_sd_configs"]
    workers = {
        name: service["environment"]["METANERF_WORKER_METRICS_PORT"]
        for name, service in compose()["services"].items()
        if service.get("command", [])[:2] == ["metanerf", "worker"]
    }
    assert dict.fromkeys(by_name["names"], by_name["port"]) == workers
    asked = [one.partition(":") for one in scraped[0]["static_configs"][0]["targets"]]
    assert [name for name, _, _ in asked] == gateways()
    for name, _, port in asked:
        assert f":{port}/" in compose()["services"][name]["healthcheck"]["test"][-1]
