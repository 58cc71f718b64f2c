"""docker-compose.yml as an engine reads it, and its services on this machine."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import yaml

ROOT = Path(__file__).resolve().parents[2]


def compose(**variables: str) -> dict[str, Any]:
    """The file with these variables put in, and the defaults of the others."""
    text = (ROOT / "docker-compose.yml").read_text()
    variable = re.compile(r"(?<!\$)\$\{(\w+):-([^}]*)\}")
    return yaml.safe_load(variable.sub(lambda found: variables.get(found[1], found[2]), text))


def gateways() -> list[str]:
    """Names of the services that are gateways."""
    return [name for name in compose()["services"] if name.startswith("gateway-")]


def make_secrets(folder: Path) -> Path:
    """The folder of secrets that scripts/secrets.sh makes below `folder`."""
    subprocess.run([ROOT / "scripts" / "secrets.sh", folder], check=True, capture_output=True)
    return folder / "secrets"


@dataclass(frozen=True)
class Stores:
    """What stands for the file's stores, below a folder that `make_secrets` filled."""

    folder: Path
    redis_url: str
    s3_endpoint: str

    @classmethod
    def of_this_machine(
        cls, folder: Path, postgres_url: str, redis_url: str, s3_endpoint: str
    ) -> Stores:
        """With secrets, and the bucket that the file's service `bucket` makes."""
        (make_secrets(folder) / "database_url").write_text(postgres_url)
        httpx.put(f"{s3_endpoint}/metanerf").raise_for_status()
        return cls(folder, redis_url, s3_endpoint)

    def environment(self, service: Mapping[str, Any], port: int) -> dict[str, str]:
        """A service's own variables, with places of this machine in place of the containers'."""
        secrets = str(self.folder / "secrets")
        given = {
            name: str(value).replace("/run/secrets", secrets)
            for name, value in service["environment"].items()
        }
        return {
            **{k: v for k, v in os.environ.items() if not k.startswith("METANERF_")},
            **given,
            "METANERF_REDIS_URL": self.redis_url,
            "METANERF_S3_ENDPOINT_URL": self.s3_endpoint,
            "METANERF_DATA_DIR": str(self.folder / given["METANERF_NODE_ID"]),
            "METANERF_PORT": str(port),
            "METANERF_WORKER_METRICS_PORT": str(port),
        }

    def start(self, service: Mapping[str, Any], port: int) -> subprocess.Popen[str]:
        """One of ours, by its own command; what it says is piped."""
        program, *words = service["command"]
        assert program == "metanerf"
        main = [sys.executable, "-c", "from services.cli import main; main()"]
        environment = self.environment(service, port)
        return subprocess.Popen([*main, *words], env=environment, stderr=subprocess.PIPE, text=True)


def wait_ready(port: int, seconds: float = 60.0) -> dict[str, str]:
    """What a gateway says of its stores once it is ready."""
    give_up = time.monotonic() + seconds
    while time.monotonic() < give_up:
        try:
            answer = httpx.get(f"http://127.0.0.1:{port}/readyz", timeout=2.0)
            if answer.is_success:
                return answer.json()["checks"]
        except httpx.TransportError:
            pass
        time.sleep(0.3)
    raise AssertionError(f"port {port} was not ready in {seconds} s")
