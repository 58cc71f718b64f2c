"""What this machine lacks to serve meetings with its settings, found by trying each thing."""

from __future__ import annotations

import asyncio
import json
import os
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
from aiortc import RTCConfiguration, RTCIceServer, RTCPeerConnection
from av import VideoFrame
from av.error import FFmpegError

from capture.detection.network_files import landmark_network_file
from db.objects import free_bytes
from renderer.devices import best_device
from scene.errors import SceneError
from services.composition import build_services
from services.confinement import ConfinedProcess
from services.container import utc_now
from services.live.ice_servers import IceServer, ice_servers
from services.live.streaming.encoding import Codec, PictureEncoder
from services.readiness import OK, check_stores
from services.settings import Settings

_LEAST_CORES = 2
_LEAST_FREE_GB = 2.0
_RELAY_S = 5.0
"""A relay that answers later is of no use to a page that wants to connect."""
_BITRATE = 1_000_000
_TRIAL_BYTES, _TRIAL_S = 4096, 20.0
_ADDRESSES = {"database": "DATABASE_URL", "objects": "OBJECT_STORE_URL", "redis": "REDIS_URL"}


@dataclass(frozen=True)
class Finding:
    """One thing that was tried."""

    what: str
    found: str
    advice: str = ""
    """How to mend it; empty where nothing is to be mended."""


def examine(settings: Settings) -> Iterator[Finding]:
    """Every finding, as it is made. Landmark models that are missing are fetched."""
    yield _cores()
    yield _device()
    for codec in Codec:
        yield _codec(codec)
    yield from _stores(settings)
    yield _disk(settings)
    yield _confinement()
    yield _port(settings)
    yield _udp()
    for server in ice_servers(settings.live, "doctor", utc_now()):
        if server.username:
            for url in server.urls:
                yield _relay(url, server)
    yield from _landmark_models(settings)
    yield _page(settings)


def _cores() -> Finding:
    cores = len(os.sched_getaffinity(0))
    few = cores < _LEAST_CORES
    return Finding("cores", str(cores), f"give it {_LEAST_CORES} or more" if few else "")


def _device() -> Finding:
    if best_device().type != "cuda":
        return Finding("GPU", "none that torch can use; none is needed")
    if find_spec("triton") is None:
        return Finding("GPU", "CUDA, without Triton", "pip install '.[gpu]'")
    return Finding("GPU", "CUDA, with Triton")


def _codec(codec: Codec) -> Finding:
    what = f"{codec.value} encoder"
    picture = VideoFrame.from_ndarray(np.zeros((96, 64), np.uint8), format="yuv420p")
    try:
        PictureEncoder(codec).encode(picture, 0, _BITRATE, key=True)
    except (FFmpegError, ValueError) as error:
        return Finding(what, str(error), "install PyAV from its wheel, which brings it")
    return Finding(what, OK)


def _stores(settings: Settings) -> Iterator[Finding]:
    services = build_services(settings)
    try:
        for store, state in check_stores(services).items():
            advice = "" if state == OK else f"start it, or correct METANERF_{_ADDRESSES[store]}"
            yield Finding(store, state, advice)
    finally:
        services.close()


def _disk(settings: Settings) -> Finding:
    folder = settings.folders.data_dir
    free_gb = free_bytes(folder) / 1e9
    full = free_gb < _LEAST_FREE_GB
    advice = f"free {_LEAST_FREE_GB:g} GB, or set METANERF_DATA_DIR" if full else ""
    return Finding("free space", f"{free_gb:.0f} GB in {folder}", advice)


def _confinement() -> Finding:
    """Whether what reads strangers' clips is held back from the rest of the machine."""
    what = "confinement"
    with ConfinedProcess("services.confinement_trial") as process:
        try:
            said = process.read(_TRIAL_BYTES, _TRIAL_S)
            how = "" if process.wait(_TRIAL_S) == 0 else process.how_ended()
        except TimeoutError as error:
            how, said = str(error), b""
    if how:
        return Finding(what, how, "no clip can be read: see `python -m services.confinement_trial`")
    free = [name for name, held in json.loads(said).items() if not held]
    if not free:
        return Finding(what, "a hostile clip reaches neither files nor sockets")
    advice = "run Linux 5.13 or later with Landlock and seccomp, or let in only people you trust"
    return Finding(what, f"a hostile clip would reach {' and '.join(free)}", advice)


def _port(settings: Settings) -> Finding:
    host, port = settings.server.host, settings.server.port
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            advice = "if that is not the gateway itself, end it or set METANERF_PORT"
            return Finding("port", f"{port} of {host}: {error.strerror}", advice)
    return Finding("port", f"{port} of {host} is free")


def _udp() -> Finding:
    """Whether packets pass over the addresses that connections are offered on."""
    offered = asyncio.run(_candidates([]))
    addresses = sorted({address for kind, address in offered if kind == "host"})
    for address in addresses:
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        with socket.socket(family, socket.SOCK_DGRAM) as own:
            own.settimeout(1.0)
            try:
                own.bind((address, 0))
                own.sendto(b"ping", own.getsockname())
                own.recv(16)
            except OSError as error:
                return Finding("UDP", f"{address}: {error}", "let UDP through the firewall")
    if not addresses:
        return Finding("UDP", "no address but loopback", "connect the machine to a network")
    return Finding("UDP", ", ".join(addresses))


def _relay(url: str, server: IceServer) -> Finding:
    asked = RTCIceServer(urls=url, username=server.username, credential=server.credential)
    try:
        offered = asyncio.run(asyncio.wait_for(_candidates([asked]), _RELAY_S))
    except (OSError, TimeoutError, ValueError):
        offered = []
    given = any(kind == "relay" for kind, _ in offered)
    advice = "start it, with the secret of METANERF_TURN_SECRET, or correct METANERF_TURN_URLS"
    return Finding(f"relay {url}", OK if given else "gives no relay", "" if given else advice)


async def _candidates(servers: list[RTCIceServer]) -> list[tuple[str, str]]:
    """Kind and address of everything that a connection of this machine would offer."""
    connection = RTCPeerConnection(RTCConfiguration(iceServers=servers))
    try:
        connection.createDataChannel("doctor")
        await connection.setLocalDescription(await connection.createOffer())
        sdp = connection.localDescription.sdp
    finally:
        await connection.close()
    found = [line.split() for line in sdp.splitlines() if line.startswith("a=candidate:")]
    # a=candidate:FOUNDATION COMPONENT TRANSPORT PRIORITY ADDRESS PORT typ KIND (RFC 8839)
    return [(words[7], words[4]) for words in found]


def _landmark_models(settings: Settings) -> Iterator[Finding]:
    for source in (
        settings.pose_model_source(),
        settings.face_model_source(),
        settings.hand_model_source(),
    ):
        what = f"{source.model.name} model"
        try:
            yield Finding(what, str(landmark_network_file(source)))
        except SceneError as error:
            yield Finding(what, "missing", str(error))


def _page(settings: Settings) -> Finding:
    index = settings.server.client_dir / "index.html"
    built = index.is_file()
    return Finding("page", str(index.parent), "" if built else "build it: scripts/setup.sh")
