"""Images are pinned by what a registry says their tags are, all of them or none."""

from __future__ import annotations

import hashlib
import shutil
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest

from tests.servers import free_port
from tools.pin_images import (
    ROOT,
    Image,
    NotPinned,
    digest_of,
    files_of,
    images_in,
    pin_files,
    pinned,
    read_image,
)


def digest(words: str) -> str:
    return f"sha256:{hashlib.sha256(words.encode()).hexdigest()}"


class Registry:
    """Speaks what the distribution specification has for reading manifests, with tokens."""

    def __init__(self) -> None:
        self.digests: dict[str, str] = {}
        """By path and tag."""
        self.realm = ""
        self.accepted: list[str] = []
        registry = self

        class Handler(BaseHTTPRequestHandler):
            def do_HEAD(self) -> None:
                path = urlsplit(self.path).path
                name, _, tag = path.removeprefix("/v2/").partition("/manifests/")
                if self.headers["Authorization"] != f"Bearer for repository:{name}:pull":
                    self.send_response(401)
                    challenge = (
                        f'Bearer realm="{registry.realm}",service="the registry",'
                        f'scope="repository:{name}:pull"'
                    )
                    self.send_header("WWW-Authenticate", challenge)
                elif found := registry.digests.get(f"{name}:{tag}"):
                    registry.accepted.append(self.headers["Accept"])
                    self.send_response(200)
                    self.send_header("Docker-Content-Digest", found)
                else:
                    self.send_response(404)
                self.end_headers()

            def do_GET(self) -> None:
                asked = parse_qs(urlsplit(self.path).query)
                body = f'{{"token": "for {asked["scope"][0]}"}}'.encode()
                ok = urlsplit(self.path).path == "/token" and asked["service"] == ["the registry"]
                self.send_response(200 if ok else 400)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:
                """Nothing."""

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.host = f"127.0.0.1:{self._server.server_port}"
        self.realm = f"http://{self.host}/token"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


@pytest.fixture
def registry() -> Iterator[Registry]:
    made = Registry()
    yield made
    made.close()


@pytest.fixture
def client() -> Iterator[httpx.Client]:
    with httpx.Client(timeout=5.0) as made:
        yield made


@pytest.mark.parametrize(
    ("reference", "registry", "path", "tag"),
    [
        ("postgres:17.5", "docker.io", "library/postgres", "17.5"),
        ("minio/mc:RELEASE.2025", "docker.io", "minio/mc", "RELEASE.2025"),
        (f"redis:7.4.4@{digest('old')}", "docker.io", "library/redis", "7.4.4"),
        ("ghcr.io/a/b:1", "ghcr.io", "a/b", "1"),
        ("localhost:5000/metanerf:0.1.0", "localhost:5000", "metanerf", "0.1.0"),
    ],
)
def test_where_an_image_is_from(reference: str, registry: str, path: str, tag: str):
    image = read_image(reference)
    assert image is not None
    assert (image.registry, image.path, image.tag) == (registry, path, tag)


def test_what_is_built_here_has_no_digest_and_what_has_no_tag_is_refused():
    assert read_image("metanerf-proxy:0.1.0") is None
    for reference in ("postgres", "localhost:5000/postgres"):
        with pytest.raises(NotPinned, match="must have an exact tag"):
            read_image(reference)


def test_every_image_of_ours_is_found():
    names = set()
    for path in files_of(ROOT):
        names |= {image.name for image in images_in(path.read_text())}
    assert {"postgres", "redis", "coturn/coturn", "minio/minio", "caddy", "python"} <= names
    assert not [name for name in names if "metanerf" in name]


def test_only_references_change_and_again_only_their_digests():
    text = (
        "# image: postgres:16\n"
        "services:\n"
        "  a: { image: this:1 }\n"
        "  b:\n"
        "    image: postgres:17.5  # of rows\n"
        "    image: metanerf:0.1.0\n"
    )
    image = Image("postgres", "17.5")
    once = pinned(text, {image: digest("one")})
    assert once == text.replace("postgres:17.5", f"postgres:17.5@{digest('one')}")
    assert pinned(once, {image: digest("two")}) == once.replace(digest("one"), digest("two"))
    stages = "FROM python:3.11 AS base\nFROM base\nFROM --platform=linux/amd64 node:20 AS page\n"
    assert images_in(stages) == {Image("python", "3.11"), Image("node", "20")}


def test_a_tags_digest_is_read_with_a_token(registry: Registry, client: httpx.Client):
    registry.digests["some/thing:1"] = digest("all platforms")
    assert digest_of(client, Image(f"{registry.host}/some/thing", "1")) == digest("all platforms")
    # else it would tell the digest of an old manifest, of one platform alone
    assert registry.accepted[0].startswith("application/vnd.oci.image.index.v1+json, ")


@pytest.mark.parametrize(
    ("realm", "told"),
    [
        ("http://registry.example/token", "got the challenge"),
        ("file:///etc/passwd", "got the challenge"),
        ("", "got the challenge"),
    ],
)
def test_a_token_is_asked_for_by_tls_alone(
    registry: Registry, client: httpx.Client, realm: str, told: str
):
    registry.realm = realm
    with pytest.raises(NotPinned, match=told):
        digest_of(client, Image(f"{registry.host}/some/thing", "1"))


def test_a_digest_that_is_none_is_refused(registry: Registry, client: httpx.Client):
    registry.digests["some/thing:1"] = "sha256:1234\tor so"
    with pytest.raises(NotPinned, match="got the digest 'sha256:1234"):
        digest_of(client, Image(f"{registry.host}/some/thing", "1"))


def test_all_files_are_pinned_or_none(registry: Registry, client: httpx.Client, tmp_path: Path):
    """Our own, as if their images were in this registry."""
    (tmp_path / "deploy").mkdir()
    shutil.copytree(ROOT / "deploy" / "kubernetes", tmp_path / "deploy" / "kubernetes")
    for name in ("docker-compose.yml", "Dockerfile"):
        shutil.copy(ROOT / name, tmp_path)
    paths = files_of(tmp_path)
    before = {path: path.read_text() for path in paths}
    images = set[Image]().union(*map(images_in, before.values()))

    def learn(image: Image) -> str:
        return digest_of(client, Image(f"{registry.host}/{image.path}", image.tag))

    for image in images - {Image("redis", "7.4.4")}:
        registry.digests[f"{image.path}:{image.tag}"] = digest(image.name)
    with pytest.raises(NotPinned, match=r"redis:7.4.4 must tell its digest; got .*404"):
        pin_files(paths, learn)
    assert {path: path.read_text() for path in paths} == before

    registry.digests["library/redis:7.4.4"] = digest("redis")
    assert set(pin_files(paths, learn)) == images
    compose = (tmp_path / "docker-compose.yml").read_text()
    assert f"image: redis:7.4.4@{digest('redis')}\n" in compose
    assert "image: metanerf-proxy:0.1.0\n" in compose
    dockerfile = (tmp_path / "Dockerfile").read_text()
    assert f"FROM caddy:2.10.0@{digest('caddy')} AS proxy\n" in dockerfile
    assert "FROM metanerf AS gpu\n" in dockerfile


def test_a_registry_that_is_away_is_said_and_nothing_is_written(
    client: httpx.Client, tmp_path: Path
):
    path = tmp_path / "compose.yml"
    path.write_text(f"services:\n  a:\n    image: 127.0.0.1:{free_port()}/a:1\n")
    before = path.read_text()
    with pytest.raises(NotPinned, match=r"must tell its digest; got .*refused.* nothing was chan"):
        pin_files([path], lambda image: digest_of(client, image))
    assert path.read_text() == before
