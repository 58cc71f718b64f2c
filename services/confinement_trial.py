"""What a confined process is held back from on this machine, tried by one (services.doctor):

    python -m services.confinement_trial

One line of JSON says whether files and sockets are out of its reach.
"""

from __future__ import annotations

import json
import socket

from services.confinement import Limits, confine

_LIMITS = Limits(memory_bytes=1 << 30, processor_s=10, file_bytes=0, open_files=32)
_SOMEBODYS = "/etc/passwd"
"""A file that every system has, and no confined process needs."""


def main() -> None:
    """Try both."""
    confine(_LIMITS)
    held = {"files": False, "sockets": False}
    try:
        with open(_SOMEBODYS):
            pass
    except PermissionError:
        held["files"] = True
    try:
        socket.socket().close()
    except PermissionError:
        held["sockets"] = True
    print(json.dumps(held))


if __name__ == "__main__":
    main()
