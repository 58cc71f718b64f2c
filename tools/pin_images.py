"""Pins the images that we run on and build from by their digests, where their registries can be
reached: `make pin`.

A tag may be moved to other bytes, a digest may not: `postgres:17.5` becomes
`postgres:17.5@sha256:...`, in docker-compose.yml, the Dockerfile and the manifests of Kubernetes.
Run again it takes the digests of today. Images that are built here have none before they are
pushed somewhere; named with their registry, they are pinned like the others. Nothing is written
unless every digest is known.

Source: the Open Container Initiative's distribution specification, section "Pull"; Docker's
registry documentation, "Token authentication".
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import httpx

ROOT = Path(__file__).resolve().parents[1]
_HUB, _HUB_ADDRESS = "docker.io", "registry-1.docker.io"
_OURS = "metanerf"
"""How names of images begin that are built here."""
_WHERE = re.compile(
    r"^(\s*image:\s*|\s*-\s+image:\s*|FROM\s+(?:--platform=\S+\s+)?)([^\s#]+)", re.M
)
_STAGE = re.compile(r"^FROM\s.*\sAS\s+(\S+)", re.M | re.I)
_DIGEST = re.compile(r"sha256:[0-9a-f]{64}")
_CHALLENGE = re.compile(r'(\w+)="([^"]*)"')
_ON_THIS_MACHINE = ("localhost", "127.0.0.1")
_KINDS = (
    # of every platform before that of one
    "application/vnd.oci.image.index.v1+json",
    "application/vnd.docker.distribution.manifest.list.v2+json",
    "application/vnd.oci.image.manifest.v1+json",
    "application/vnd.docker.distribution.manifest.v2+json",
)
_PATIENCE_S = 30.0


class NotPinned(Exception):
    """An image's digest could not be learnt."""


class Image(NamedTuple):
    """What a file names."""

    name: str
    """Without tag and digest, as it was written."""
    tag: str

    @property
    def registry(self) -> str:
        """The host, and a port if there is one."""
        first, slash, _ = self.name.partition("/")
        named = slash and (set(".:") & set(first) or first == "localhost")
        return first if named else _HUB

    @property
    def path(self) -> str:
        """Within the registry."""
        if self.registry == self.name.partition("/")[0]:
            return self.name.partition("/")[2]
        return self.name if "/" in self.name else f"library/{self.name}"


def read_image(reference: str) -> Image | None:
    """The image of a reference with a tag, pinned or not; None of one that is built here.

    Raises NotPinned for one without a tag.
    """
    tagged = reference.partition("@")[0]
    name, colon, tag = tagged.rpartition(":")
    if not colon or "/" in tag:
        name, tag = tagged, ""
    if "/" not in name and name.startswith(_OURS):
        return None
    if not tag:
        raise NotPinned(f"an image must have an exact tag; got {reference!r}; say which version")
    return Image(name, tag)


def images_in(text: str) -> set[Image]:
    """All images of a compose file, a Dockerfile or a manifest that are not built here."""
    stages = set(_STAGE.findall(text))
    references = {found[1] for found in _WHERE.findall(text)} - stages
    return {image for one in references if (image := read_image(one)) is not None}


def pinned(text: str, digests: dict[Image, str]) -> str:
    """The file with these digests; all else is as it was."""

    def pin(found: re.Match[str]) -> str:
        reference = found[2]
        image = None if reference in stages else read_image(reference)
        return found[1] + (reference if image is None else _pinned_reference(image, digests))

    stages = set(_STAGE.findall(text))
    return _WHERE.sub(pin, text)


def _pinned_reference(image: Image, digests: dict[Image, str]) -> str:
    return f"{image.name}:{image.tag}@{digests[image]}"


def digest_of(client: httpx.Client, image: Image) -> str:
    """What the tag of an image is today, for all platforms. Raises NotPinned."""
    host = _HUB_ADDRESS if image.registry == _HUB else image.registry
    url = f"{_scheme(host)}://{host}/v2/{image.path}/manifests/{image.tag}"
    headers = {"Accept": ", ".join(_KINDS)}
    try:
        answer = client.head(url, headers=headers)
        if answer.status_code == httpx.codes.UNAUTHORIZED:
            token = _token(client, answer.headers.get("www-authenticate", ""), image)
            answer = client.head(url, headers=headers | {"Authorization": f"Bearer {token}"})
        answer.raise_for_status()
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        raise _not_learnt(image, f"{str(error) or type(error).__name__} of {host}") from error
    digest = answer.headers.get("docker-content-digest", "")
    if not _DIGEST.fullmatch(digest):
        raise _not_learnt(image, f"the digest {digest!r} of {host}")
    return digest


def _token(client: httpx.Client, challenge: str, image: Image) -> str:
    """A token to read with, of whoever the registry names; nobody logs in. Raises NotPinned."""
    said = dict(_CHALLENGE.findall(challenge))
    realm = urlsplit(said.get("realm", ""))
    if not challenge.lower().startswith("bearer ") or realm.scheme != _scheme(realm.netloc):
        raise _not_learnt(image, f"the challenge {challenge!r}")
    asked = {"scope": f"repository:{image.path}:pull"}
    if "service" in said:
        asked["service"] = said["service"]
    answer = client.get(said["realm"], params=asked)
    answer.raise_for_status()
    try:
        told = answer.json()
        return str(told.get("token") or told["access_token"])
    except (ValueError, AttributeError, KeyError) as error:
        raise _not_learnt(image, f"no token of {realm.netloc}") from error


def _scheme(host: str) -> str:
    """Docker's own rule: without TLS where it never leaves the machine."""
    return "http" if host.partition(":")[0] in _ON_THIS_MACHINE else "https"


def _not_learnt(image: Image, got: str) -> NotPinned:
    return NotPinned(
        f"the registry of {image.name}:{image.tag} must tell its digest; got {got}; nothing was "
        "changed: try again where the registry can be reached, and look at name and tag"
    )


def files_of(root: Path) -> list[Path]:
    """Those that name images."""
    manifests = sorted((root / "deploy" / "kubernetes").rglob("*.yaml"))
    return [root / "docker-compose.yml", root / "Dockerfile", *manifests]


def pin_files(paths: Iterable[Path], learn: Callable[[Image], str]) -> dict[Image, str]:
    """Pin all images of these files; all of them, or none. Raises NotPinned."""
    texts = {path: path.read_text() for path in paths}
    wanted = sorted(set[Image]().union(*map(images_in, texts.values())))
    digests = {image: learn(image) for image in wanted}
    for path, text in texts.items():
        if (changed := pinned(text, digests)) != text:
            path.write_text(changed)
    return digests


def main() -> None:
    """Pin the files of this repository; exit code 1 where an image has no digest."""
    with httpx.Client(timeout=_PATIENCE_S, follow_redirects=True) as client:
        try:
            digests = pin_files(files_of(ROOT), lambda image: digest_of(client, image))
        except NotPinned as error:
            sys.exit(str(error))
    for image, digest in digests.items():
        print(f"{image.name}:{image.tag}@{digest}")


if __name__ == "__main__":
    main()
