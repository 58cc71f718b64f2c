"""docker-compose.yml as an engine reads it, and its services' environment on this machine."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]


def compose() -> dict[str, Any]:
    """The file with the defaults of its variables put in."""
    text = (ROOT / "docker-compose.yml").read_text()
    return yaml.safe_load(re.sub(r"(?<!\$)\$\{\w+:-([^}]*)\}", r"\1", text))


def make_secrets(folder: Path) -> Path:
    """The folder of secrets that scripts/secrets.sh makes below `folder`."""
    subprocess.run([ROOT / "scripts" / "secrets.sh", folder], check=True, capture_output=True)
    return folder / "secrets"


def environment(service: dict[str, Any], folder: Path, port: int, redis_url: str) -> dict[str, str]:
    """A service's own variables, with places of this machine in place of the containers'."""
    given = {
        name: str(value).replace("/run/secrets", str(folder / "secrets"))
        for name, value in service["environment"].items()
    }
    return {
        **{k: v for k, v in os.environ.items() if not k.startswith("METANERF_")},
        **given,
        "METANERF_REDIS_URL": redis_url,
        "METANERF_OBJECT_STORE_URL": f"file://{folder}/objects",
        "METANERF_DATA_DIR": str(folder / "data"),
        "METANERF_PORT": str(port),
    }
