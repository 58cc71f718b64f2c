"""The proxy by its own command and configuration, in front of gateways of this machine."""

from __future__ import annotations

import socket
import ssl
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest

from tests.deploy.composed import ROOT, compose, gateways
from tests.servers import program

CADDYFILE = ROOT / "deploy" / "Caddyfile"
_PATIENCE_S = 30.0


@dataclass(frozen=True)
class Proxy:
    """Where it is, and whom its callers have to trust."""

    domain: str
    """Host and port."""
    authority: Path
    """The certificate of the authority that it made itself."""

    @property
    def url(self) -> str:
        """The address that all gateways share."""
        return f"https://{self.domain}"

    def url_of(self, gateway: str) -> str:
        """The address of one gateway alone."""
        return f"https://{gateway}.{self.domain}"

    def trust(self) -> ssl.SSLContext:
        """What takes its certificates."""
        return ssl.create_default_context(cafile=str(self.authority))


def proxy_command(folder: Path, addresses: Mapping[str, str], http: int = 80) -> list[str]:
    """The service's own, by which each gateway is at an address (host and port) of this machine."""
    configuration = folder / "Caddyfile"
    text = CADDYFILE.read_text().replace("{\n", f"{{\n\thttp_port {http}\n", 1)
    for name, address in addresses.items():
        text = text.replace(f"{name}:8000", address)
    configuration.write_text(text)
    first, *words = compose()["services"]["proxy"]["command"]
    return [program(first), *(w.replace("/etc/caddy/Caddyfile", str(configuration)) for w in words)]


@contextmanager
def proxy_to(
    ports: Mapping[str, int], folder: Path, https: int, http: int, patch: pytest.MonkeyPatch
) -> Iterator[Proxy]:
    """One that brings calls to the gateways' ports; this process trusts it, and finds its names."""
    made = Proxy(f"localhost:{https}", folder / ".local/share/caddy/pki/authorities/local/root.crt")
    command = proxy_command(folder, {name: f"127.0.0.1:{at}" for name, at in ports.items()}, http)
    process = subprocess.Popen(
        command,
        env={"HOME": str(folder), "DOMAIN": made.domain},
        stderr=subprocess.DEVNULL,
    )
    _find_names_of_localhost(patch)
    patch.setenv("SSL_CERT_FILE", str(made.authority))
    try:
        _wait_for_certificates(made, process)
        yield made
    finally:
        process.terminate()
        process.wait()


def _wait_for_certificates(made: Proxy, process: subprocess.Popen[bytes]) -> None:
    urls = [made.url, *(made.url_of(name) for name in gateways())]
    give_up = time.monotonic() + _PATIENCE_S
    while urls:
        assert process.poll() is None, "the proxy ended"
        assert time.monotonic() < give_up, f"no certificate of {urls}"
        try:
            httpx.get(f"{urls[-1]}/metrics", verify=made.trust())
            urls.pop()
        except (httpx.TransportError, OSError):
            time.sleep(0.05)


def _find_names_of_localhost(patch: pytest.MonkeyPatch) -> None:
    """Whatever ends in `.localhost` is this machine (RFC 6761), which libc alone does not know."""
    ask = socket.getaddrinfo

    def getaddrinfo(host: str | bytes | None, *about: object, **more: object) -> object:
        name = host.decode() if isinstance(host, bytes) else host
        ours = name is not None and name.endswith(".localhost")
        return ask("localhost" if ours else host, *about, **more)  # pyright: ignore[reportArgumentType]

    patch.setattr(socket, "getaddrinfo", getaddrinfo)
