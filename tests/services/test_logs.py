"""Lines of JSON have the ids of what they are about, and no line has a secret."""

from __future__ import annotations

import io
import json
import logging
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path

import httpx
import pytest

from services import logs
from services.container import Services
from services.logs import LogStyle, meeting_digest
from tests.servers import free_port
from tests.services.conftest import bearer, calling

TOKEN = "eyJhbGciOiJIUzI1NiJ9.eyJzdWIiOiJhZGEifQ.c2lnbmVk-by_us"
MEETING = "7d0e4f1b2c3a49588f6e7d8c9b0a1f2e"


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> Iterator[io.StringIO]:
    """Where this process logs to, as JSON."""
    written = io.StringIO()
    monkeypatch.setattr(sys, "stderr", written)
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    monkeypatch.setattr(logging.root, "handlers", [])
    level = logging.root.level
    logs.configure(LogStyle("json", "info", "gateway-0"))
    yield written
    logging.root.setLevel(level)
    logging.captureWarnings(False)


def told(written: str) -> list[dict[str, str]]:
    return [json.loads(line) for line in written.splitlines()]


def process(code: str, style: str = "json") -> list[str]:
    """What a process writes that logs in this style, as a job's does."""
    begun = (
        "import logging, warnings\nfrom services.logs import LogStyle, configure\n"
        f"configure(LogStyle({style!r}, 'info', 'worker-1'), job_id='j1',"
        " trace=lambda: '00-0af7-b7ad-01')\n"
    )
    command = [sys.executable, "-c", begun + code]
    return subprocess.run(command, capture_output=True, text=True).stderr.splitlines()


def test_each_line_is_one_object_with_what_is_known():
    code = "logging.getLogger('a.b').warning('two\\nlines, \"quoted\": %s', 7)\n"
    code += (
        "logging.getLogger('a.b').debug('unseen')\nwarnings.warn('old')\nraise ValueError('end')"
    )
    first, warned, last = (json.loads(line) for line in process(code))
    at = datetime.fromisoformat(first.pop("time"))
    assert at.utcoffset() == timedelta(0)
    assert abs(at.timestamp() - time.time()) < 60.0
    assert first == {
        "level": "warning",
        "logger": "a.b",
        "message": 'two\nlines, "quoted": 7',
        "node_id": "worker-1",
        "job_id": "j1",
        "trace_id": "0af7",
    }
    assert "old" in warned["message"]
    assert (last["level"], last["message"]) == ("critical", "the process ends")
    assert last["exception"].startswith("Traceback")
    assert last["exception"].endswith("ValueError: end")


@pytest.mark.parametrize("style", ["text", "json"])
@pytest.mark.parametrize(
    "secret",
    [f"it was {TOKEN}", "GET /v1/x?token=hidden-thing HTTP", "Authorization: Bearer hidden-thing"],
)
def test_no_line_holds_a_token(style: str, secret: str):
    code = f"log = logging.getLogger('a')\nlog.info('%s', {secret!r})\n"
    code += f"try: raise ValueError({secret!r})\nexcept ValueError: log.exception('failed')"
    written = "\n".join(process(code, style))
    assert "failed" in written
    assert "eyJ" not in written
    assert "hidden-thing" not in written
    assert "..." in written


async def test_a_request_that_fails_is_found_by_its_id(
    services: Services, lines: io.StringIO, monkeypatch: pytest.MonkeyPatch
):
    def broken(*_: object) -> None:
        raise RuntimeError("nobody foresaw this")

    async with calling(services) as client:
        monkeypatch.setattr(type(services), "reading", broken)
        path, headers = f"/v1/meetings/{MEETING}?token=hidden", {"X-Request-Id": "ticket-7"}
        answer = await client.get(path, headers=headers)
    assert (answer.status_code, answer.headers.get_list("x-request-id")) == (500, ["ticket-7"])
    (line,) = told(lines.getvalue())
    assert (line["request_id"], line["node_id"]) == ("ticket-7", "gateway-0")
    assert line["message"] == "GET /v1/meetings/{meeting_id} failed"
    assert line["meeting"] == meeting_digest(MEETING)
    assert "nobody foresaw this" in line["exception"]
    assert MEETING not in lines.getvalue()
    assert "hidden" not in lines.getvalue()


@pytest.mark.parametrize("given", ["", "two words", "x" * 65, "break\tout", "{}"])
async def test_an_id_that_is_none_is_replaced(client: httpx.AsyncClient, given: str):
    made = [
        (await client.get(path, headers={"X-Request-Id": given})).headers["x-request-id"]
        for path in ("/healthz", "/nowhere", "/healthz")
    ]
    assert len(set(made)) == 3
    assert all(len(one) == 32 and one != given for one in made)


def test_who_logs_about_another_says_of_which(lines: io.StringIO):
    logging.getLogger("a").warning("gone", extra={"job_id": "j2"})
    logging.getLogger("a").warning("gone")
    first, second = told(lines.getvalue())
    assert first["job_id"] == "j2"
    assert "job_id" not in second


def test_a_server_logs_no_address_whatever_its_level(services: Services, tmp_path: Path):
    port = free_port()
    environment = os.environ | {
        "METANERF_LOG_FORMAT": "json",
        "METANERF_LOG_LEVEL": "debug",
        "METANERF_PORT": str(port),
        "METANERF_DATA_DIR": str(services.settings.folders.data_dir),
        "METANERF_EMBEDDED_WORKER": "false",
    }
    written = tmp_path / "log"
    with written.open("w") as file:
        command = [sys.executable, "-m", "services.cli", "serve"]
        server = subprocess.Popen(command, env=environment, stderr=file)
        try:
            with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30.0) as caller:
                for _ in range(300):
                    try:
                        caller.get("/healthz")
                        break
                    except httpx.TransportError:
                        time.sleep(0.1)
                path = f"/v1/meetings/{MEETING}"
                answer = caller.get(f"{path}?token=hidden", headers=bearer(services))
                assert answer.status_code in (401, 404)
                caller.get(f"{path}/control?token=hidden", headers={"upgrade": "websocket"})
                with socket.create_connection(("127.0.0.1", port)) as strange:
                    strange.sendall(b"nothing that is HTTP\r\n\r\n")
                    strange.recv(1000)
        finally:
            server.terminate()
            server.wait(30.0)
    whole = written.read_text()
    # the server's own lines look like ours
    assert ("uvicorn.error", "Invalid HTTP request received.") in [
        (line["logger"], line["message"]) for line in told(whole)
    ]
    assert MEETING not in whole
    assert "hidden" not in whole
