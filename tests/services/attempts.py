"""What somebody could do who took a confined process over, tried in its own confinement."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def nothing_is_reached(module: str, folder: Path) -> None:
    """No file, process, network nor much memory by the `LIMITS` of `module`; `folder` is empty."""
    secret = folder / "secret"
    secret.write_text("of the server")
    begun = (
        f"from services.confinement import confine\nfrom {module} import LIMITS\nconfine(LIMITS)\n"
    )
    for attempt, error in (
        (f"print(open({str(secret)!r}).read())", "PermissionError"),
        (f"open({str(folder / 'planted')!r}, 'w').write('x')", "PermissionError"),
        (f"import os; os.kill({os.getpid()}, 0)", "PermissionError"),
        ("import socket; socket.socket(socket.AF_INET, socket.SOCK_DGRAM)", "PermissionError"),
        ("bytearray(600 << 20)", "MemoryError"),
    ):
        done = subprocess.run(
            [sys.executable, "-c", begun + attempt], capture_output=True, text=True, check=False
        )
        assert error in done.stderr, attempt
        assert "of the server" not in done.stdout
