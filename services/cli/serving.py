"""Commands that serve: demo, serve, worker."""

from __future__ import annotations

import signal
import socket
import threading
import webbrowser
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scene.errors import InvalidInput, SceneError
from services import logs

if TYPE_CHECKING:
    from services.jobs.engine import Engine
    from services.setting_groups import ServerSettings
    from services.settings import Settings

app = typer.Typer()

Port = Annotated[int | None, typer.Option(help="Port to listen on.", min=0, max=65535)]
_DEMO_NAME = "Ada"


class EngineName(StrEnum):
    """Homes of jobs."""

    LOCAL = "local"
    RAY = "ray"


class PortTaken(SceneError):
    """Another program listens there."""


@app.command()
def demo(
    port: Port = None,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
    data_dir: Annotated[Path | None, typer.Option(help="Folder for all data.")] = None,
) -> None:
    """Run the meeting on this machine, without an account, and open its page in the browser."""
    typer.echo("\n  MetaNeRF is starting")
    from services.bootstrap import DEMO_MODEL, ensure_demo
    from services.composition import build_services
    from services.settings import load_settings

    settings = load_settings(open_access=True, **_given(port=port, data_dir=data_dir))
    listener = _listen(settings.server)
    services = build_services(settings)
    services.database.migrate()
    ensure_demo(services, DEMO_MODEL, _DEMO_NAME)
    services.close()
    address = f"http://{settings.server.host}:{listener.getsockname()[1]}/"
    typer.secho(f"  MetaNeRF is open at {address}   (Ctrl-C ends it)\n", bold=True)
    if browser:
        threading.Timer(1.0, webbrowser.open, [address]).start()
    _serve(settings, listener)


@app.command()
def serve(port: Port = None) -> None:
    """Run the gateway: REST, WebRTC and the page. Settings come from METANERF_* variables."""
    from services.settings import load_settings

    settings = load_settings(**_given(port=port))
    _serve(settings, _listen(settings.server))


@app.command()
def worker(
    kinds: Annotated[
        list[str] | None, typer.Argument(help="Kinds of jobs to take: capture, train, export.")
    ] = None,
    engine: Annotated[
        EngineName,
        typer.Option(
            help="Where jobs run: child processes, or the cluster of METANERF_RAY_ADDRESS."
        ),
    ] = EngineName.LOCAL,
) -> None:
    """Run jobs for a gateway that does not run them itself (METANERF_EMBEDDED_WORKER=false)."""
    from db.models import JobKind
    from services.composition import build_services
    from services.jobs.worker import Worker
    from services.settings import load_settings

    settings = load_settings(**_given(worker_kinds=kinds))
    services = build_services(settings)
    logs.configure(settings.server.log_style, trace=services.tracing.here)
    _serve_figures(settings)
    services.database.migrate()
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    taken = [JobKind(kind) for kind in settings.jobs.worker_kinds]
    Worker(services, taken, _open_engine(engine, settings)).run(stop)
    services.close()


def _serve_figures(settings: Settings) -> None:
    """A worker's own, where a port is set. Raises PortTaken."""
    from prometheus_client import start_http_server

    from services.process_figures import describe_process

    host, port = settings.server.host, settings.jobs.metrics_port
    if port == 0:
        return
    describe_process(settings.server.log_style.node_id)
    try:
        start_http_server(port, host)
    except OSError as error:
        raise PortTaken(
            f"port {port} of {host} must be free for a worker's figures; got {error.strerror}; end "
            "the other program or set METANERF_WORKER_METRICS_PORT to another"
        ) from error


def _open_engine(name: EngineName, settings: Settings) -> Engine:
    """The engine of that name. Raises InvalidInput where Ray is not installed."""
    if name is EngineName.LOCAL:
        from services.jobs.local_engine import LocalEngine

        return LocalEngine(settings)
    from services.composition import require_ray

    require_ray("--engine ray")
    from services.jobs.ray_engine import RayEngine

    return RayEngine(settings)


def _serve(settings: Settings, listener: socket.socket) -> None:
    from services.app import create_app
    from services.composition import build_services
    from services.draining_server import DrainingServer, gateway_config
    from services.gateway import gateway_of

    services = build_services(settings)
    logs.configure(settings.server.log_style, trace=services.tracing.here)
    app = create_app(services)
    server = DrainingServer(gateway_config(app), gateway_of(app), settings.server.drain_s)
    server.run(sockets=[listener])


def _listen(server: ServerSettings) -> socket.socket:
    """The listening socket, taken before any work is done. Raises PortTaken."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((server.host, server.port))
        listener.listen(128)
    except OSError as error:
        listener.close()
        raise PortTaken(
            f"port {server.port} of {server.host} must be free; got {error.strerror}; "
            f"end the other program or choose another port with --port"
        ) from error
    return listener


def _given(**values: object) -> dict[str, object]:
    """Only what was given on the command line: the rest is the environment's."""
    given = {name: value for name, value in values.items() if value is not None}
    known = {"capture", "train", "export"}
    if "worker_kinds" in given and not set(given["worker_kinds"]) <= known:  # type: ignore[arg-type]
        raise InvalidInput(f"kinds must be among {sorted(known)}; got {given['worker_kinds']}")
    return given
