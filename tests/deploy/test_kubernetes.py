"""deploy/kubernetes: valid manifests, with commands and settings that there are.

No cluster is needed: Kubernetes' own schemas judge its kinds. Of KubeRay's kind, whose schema no
package holds, the fields' names are listed here, and its pods are judged as any other pod.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import typer
import yaml

from services.cli.app import app
from services.settings import load_settings
from tests.deploy.composed import ROOT, make_secrets
from tests.deploy.image import stage

FOLDER = ROOT / "deploy" / "kubernetes"
VERSION = "1.34"
"""Of Kubernetes, by whose schemas all is judged."""
_MOUNTED = "/run/secrets/metanerf"
RAY_CLUSTER = {
    "": {
        "rayVersion",
        "enableInTreeAutoscaling",
        "autoscalerOptions",
        "headGroupSpec",
        "workerGroupSpecs",
    },
    "autoscalerOptions": {"upscalingMode", "idleTimeoutSeconds", "securityContext", "resources"},
    "headGroupSpec": {"rayStartParams", "template"},
    "workerGroupSpecs": {
        "groupName",
        "replicas",
        "minReplicas",
        "maxReplicas",
        "rayStartParams",
        "template",
    },
}
"""Fields of `ray.io/v1` RayCluster's spec that we use, by where they stand."""


def documents() -> list[dict[str, Any]]:
    """Every resource."""
    paths = sorted(path for path in FOLDER.rglob("*.yaml") if path.name != "kustomization.yaml")
    return [one for path in paths for one in yaml.safe_load_all(path.read_text())]


def of_kind(kind: str) -> list[dict[str, Any]]:
    return [one for one in documents() if one["kind"] == kind]


def groups() -> list[dict[str, Any]]:
    """Head and nodes of the Ray cluster."""
    (cluster,) = of_kind("RayCluster")
    return [cluster["spec"]["headGroupSpec"], *cluster["spec"]["workerGroupSpecs"]]


def pods() -> list[dict[str, Any]]:
    """Every pod's template."""
    deployed = [*of_kind("Deployment"), *of_kind("StatefulSet")]
    return [one["spec"]["template"] for one in deployed] + [group["template"] for group in groups()]


def containers() -> Iterator[dict[str, Any]]:
    for pod in pods():
        yield from pod["spec"]["containers"]


def test_every_resource_is_valid_by_kubernetes_schemas():
    for one in documents():
        if one["kind"] != "RayCluster":
            kubernetes_validate.validate(one, VERSION, strict=True)


def test_the_ray_cluster_is_one_by_its_fields_and_its_pods_are_pods():
    (cluster,) = of_kind("RayCluster")
    assert cluster["apiVersion"] == "ray.io/v1"
    spec = cluster["spec"]
    assert set(spec) == RAY_CLUSTER[""]
    assert set(spec["autoscalerOptions"]) == RAY_CLUSTER["autoscalerOptions"]
    assert set(spec["headGroupSpec"]) == RAY_CLUSTER["headGroupSpec"]
    for group in spec["workerGroupSpecs"]:
        assert set(group) == RAY_CLUSTER["workerGroupSpecs"]
    for group in groups():
        judged = {"apiVersion": "v1", "kind": "PodTemplate", "metadata": {"name": "one"}}
        kubernetes_validate.validate(judged | {"template": group["template"]}, VERSION, strict=True)


def test_the_cluster_runs_the_version_of_ray_that_is_pinned_by_options_that_it_has():
    from ray.scripts.scripts import start

    (cluster,) = of_kind("RayCluster")
    pinned = f"ray=={cluster['spec']['rayVersion']}"
    assert pinned in (ROOT / "requirements-cluster.lock").read_text()
    options = {name for option in start.params for name in option.opts}
    for group in groups():
        values = group["rayStartParams"]
        assert {f"--{name}" for name in values} <= options
        assert all(isinstance(value, str) for value in values.values())


def test_a_node_has_its_kernels_before_ray_takes_the_place_of_the_images_entry():
    [entry] = [json.loads(one.rest) for one in stage("metanerf") if one.word == "ENTRYPOINT"]
    (cluster,) = of_kind("RayCluster")
    for group in cluster["spec"]["workerGroupSpecs"]:
        (node,) = group["template"]["spec"]["containers"]
        assert node["args"] == [entry[-1].partition(";")[0]]


def test_nodes_go_and_come_as_jobs_do():
    (cluster,) = of_kind("RayCluster")
    spec = cluster["spec"]
    assert spec["enableInTreeAutoscaling"]
    assert spec["headGroupSpec"]["rayStartParams"]["num-cpus"] == "0"
    for group in spec["workerGroupSpecs"]:
        assert (group["replicas"], group["minReplicas"]) == (0, 0)


def test_kustomizations_name_what_is_there():
    for path in FOLDER.rglob("kustomization.yaml"):
        written = yaml.safe_load(path.read_text())
        assert written["kind"] == "Kustomization"
        beside = {one.name for one in path.parent.glob("*.yaml")} - {path.name}
        assert beside == {name for name in written["resources"] if name.endswith(".yaml")}
        for name in written["resources"]:
            assert (path.parent / name).exists(), name
        named = {(one["kind"], one["metadata"]["name"]) for one in documents()}
        for patch in written.get("patches", ()):
            gone = yaml.safe_load(patch["patch"])
            assert (gone["kind"], gone["metadata"]["name"]) in named


def test_every_command_of_ours_parses():
    # as arguments, so that the image's own entry is kept
    assert not any("command" in one for one in containers())
    commands = [one["args"] for one in containers() if one["name"] not in ("ray-head", "ray-node")]
    assert len(commands) == 3
    group = typer.main.get_command(app)
    for program, name, *words in commands:
        assert program == "metanerf"
        with group.make_context(program, [name, *words], resilient_parsing=False) as context:
            command = group.get_command(context, name)  # pyright: ignore[reportAttributeAccessIssue]
            assert command is not None, name
            command.make_context(name, list(words))


def test_every_setting_is_one_and_is_valid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (shared,) = of_kind("ConfigMap")
    secrets = make_secrets(tmp_path)
    known = set(load_settings().by_variable())
    for one in containers():
        own = {given["name"]: given["value"] for given in one.get("env", ()) if "value" in given}
        given = (shared["data"] if "envFrom" in one else {}) | own
        with monkeypatch.context() as patch:
            for name, value in given.items():
                if name.startswith("METANERF_"):
                    assert name.removesuffix("_FILE") in known, name
                    patch.setenv(name, value.replace(_MOUNTED, str(secrets)))
            load_settings(data_dir=tmp_path)


def test_every_process_of_ours_says_in_its_lines_which_it_is():
    (shared,) = of_kind("ConfigMap")
    assert shared["data"]["METANERF_LOG_FORMAT"] == "json"
    for one in containers():
        if "envFrom" in one:
            given = {variable["name"]: variable for variable in one["env"]}
            name = given["METANERF_NODE_ID"]["valueFrom"]["fieldRef"]
            assert name == {"fieldPath": "metadata.name"}


def test_secrets_are_referred_to_and_mounted_where_they_are_read():
    for pod in pods():
        volumes = {one["name"]: one for one in pod["spec"]["volumes"]}
        for one in pod["spec"]["containers"]:
            mounts = {mount["mountPath"]: mount["name"] for mount in one["volumeMounts"]}
            assert set(mounts.values()) <= set(volumes)
            if "envFrom" in one:
                assert one["envFrom"] == [{"configMapRef": {"name": "metanerf"}}]
                assert volumes[mounts[_MOUNTED]]["secret"]["secretName"] == "metanerf"
    assert of_kind("Secret") == []


def test_pods_may_do_no_more_than_they_have_to():
    for pod in pods():
        spec = pod["spec"]
        assert spec["securityContext"]["runAsNonRoot"]
        assert not spec.get("hostNetwork")
        for one in spec["containers"]:
            security = one["securityContext"]
            assert security["readOnlyRootFilesystem"]
            assert not security["allowPrivilegeEscalation"]
            assert security["capabilities"] == {"drop": ["ALL"]}
            assert {"requests", "limits"} == set(one["resources"])
            assert "memory" in one["resources"]["limits"]


def test_a_gateway_lives_by_its_own_health_and_is_drained_before_it_ends():
    (gateway,) = of_kind("StatefulSet")
    spec = gateway["spec"]["template"]["spec"]
    (container,) = spec["containers"]
    assert container["livenessProbe"]["httpGet"]["path"] == "/healthz"
    assert container["readinessProbe"]["httpGet"]["path"] == "/readyz"
    waits_s = container["lifecycle"]["preStop"]["sleep"]["seconds"]
    assert waits_s > container["readinessProbe"]["periodSeconds"]
    settings = load_settings()
    ends_s = settings.server.drain_s + settings.jobs.stop_grace_s
    assert spec["terminationGracePeriodSeconds"] > waits_s + ends_s
    (budget,) = of_kind("PodDisruptionBudget")
    assert budget["spec"]["selector"] == gateway["spec"]["selector"]


def test_each_gateway_is_reached_by_an_address_of_its_own():
    (gateway,) = of_kind("StatefulSet")
    (container,) = gateway["spec"]["template"]["spec"]["containers"]
    given = {one["name"]: one for one in container["env"]}
    url = given["METANERF_GATEWAY_URL"]["value"]
    assert url.startswith("https://$(METANERF_NODE_ID).")
    names = list(given)
    # or it is not put in
    assert names.index("METANERF_NODE_ID") < names.index("METANERF_GATEWAY_URL")
    services = {one["metadata"]["name"]: one["spec"] for one in of_kind("Service")}
    for number in range(gateway["spec"]["replicas"]):
        pod = f"gateway-{number}"
        assert services[pod]["selector"] == {"statefulset.kubernetes.io/pod-name": pod}
    assert services[gateway["spec"]["serviceName"]]["selector"] == {"app": "gateway"}


def test_only_the_cluster_itself_reaches_ray():
    (policy,) = of_kind("NetworkPolicy")
    label = policy["spec"]["podSelector"]["matchLabels"]
    assert policy["spec"]["ingress"] == [{"from": [{"podSelector": {"matchLabels": label}}]}]
    for group in groups():
        assert group["template"]["metadata"]["labels"].items() >= label.items()
    exposed = [one["spec"]["selector"] for one in of_kind("Service")]
    assert label not in exposed
