"""The service `turn` of docker-compose.yml by its own command, below a folder."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from tests.deploy.composed import ROOT, compose
from tests.servers import program

LOOKS_S = 0.1
"""It looks for another certificate so often, in place of each ten seconds."""


def relay_command(folder: Path, ports: Mapping[int, int]) -> list[str]:
    """What to run; `folder` holds `secrets` and in `proxy` what the proxy keeps. `ports` are of
    this machine in place of those of the file; the others stay."""
    assert program("turnserver")
    service = compose()["services"]["turn"]
    settings = (ROOT / "deploy" / "turnserver.conf").read_text()
    for there, here in ports.items():
        settings = settings.replace(f"port={there}\n", f"port={here}\n")
    (folder / "turnserver.conf").write_text(settings)
    (folder / "tmp").mkdir()
    shell, script = service["entrypoint"]
    [source] = [one.split(":")[0] for one in service["volumes"] if one.split(":")[1] == script]
    text = (ROOT / source).read_text().replace("sleep 10", f"sleep {LOOKS_S}")
    for there, here in {
        "/etc/coturn": folder,
        "/run/secrets": folder / "secrets",
        "/tmp/turn": f"{folder}/tmp/turn",
        "/proxy": folder / "proxy",
    }.items():
        text = re.sub(rf"(?<![\w.]){re.escape(there)}", str(here), text)
    (folder / "turn.sh").write_text(text)
    return [shell, str(folder / "turn.sh")]
