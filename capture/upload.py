"""Uploads a clip, a sequence's frames or keypoints to the service; a cut upload goes on later.

The service keeps what has come (its `uploads` routes): pieces are sent in order, each says where it
begins, and after a broken connection the client asks how far the upload is.
"""

from __future__ import annotations

import hashlib
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx

from capture.errors import CaptureStopped, UploadFailed

PIECE_BYTES = 1 << 20
_ATTEMPTS = 5
"""Times a piece is tried again before the upload is given up (it can still be resumed later)."""
_FIRST_PAUSE_S = 0.5


class _Refused(UploadFailed):
    """The service answered, and does not want it: sending again would not help."""


def upload(
    source: Path,
    address: str,
    person: str,
    token: str | None = None,
    *,
    height_m: float | None = None,
    on_progress: Callable[[float, str], None] = lambda done, message: None,
    should_stop: Callable[[], bool] = lambda: False,
    transport: httpx.BaseTransport | None = None,
    sleep: Callable[[float], None] = time.sleep,
) -> dict[str, Any]:
    """Upload `source` as a clip of `person`; returns the service's sequence.

    A folder with images (a sequence) travels as a zip of its frames. `person` is an id, or the name
    of a person who is made if there is none; `height_m`, barefoot, is told as they are made. Raises
    UploadFailed with what the service said, and CaptureStopped; both leave what has come, and the
    same call goes on from there.
    """
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    with (
        tempfile.TemporaryDirectory(prefix="metanerf-upload-") as folder,
        httpx.Client(base_url=address, headers=headers, transport=transport, timeout=60) as client,
    ):
        if token is None:
            client.headers["Authorization"] = f"Bearer {_ask(client, 'POST', '/v1/guest')['token']}"
        file = _zipped(source, Path(folder)) if source.is_dir() else source
        known = _known_person(client, person, height_m)
        person_id = known or _new_person(client, person, height_m)
        try:
            begun = _begin(client, file, person_id)
            if "sequence" in begun:
                on_progress(1.0, "the service has it already")
                return begun["sequence"]
            return _send(client, file, begun, on_progress, should_stop, sleep)
        except _Refused:
            if known is None:  # who was made for this clip goes with it
                client.delete(f"/v1/people/{person_id}")
            raise


def _begin(client: httpx.Client, file: Path, person_id: str) -> dict[str, Any]:
    about = {"filename": file.name, "size": file.stat().st_size, "sha256": _sha256(file)}
    return _ask(client, "POST", f"/v1/people/{person_id}/uploads", json=about)


def _send(
    client: httpx.Client,
    file: Path,
    begun: dict[str, Any],
    on_progress: Callable[[float, str], None],
    should_stop: Callable[[], bool],
    sleep: Callable[[float], None],
) -> dict[str, Any]:
    path, offset, failures = f"/v1/uploads/{begun['id']}", int(begun["offset"]), 0
    size = file.stat().st_size
    with file.open("rb") as stream:
        while True:
            if should_stop():
                raise CaptureStopped(f"the upload was stopped at {offset} of {size} bytes")
            stream.seek(offset)
            try:
                answer = client.patch(
                    path,
                    content=stream.read(PIECE_BYTES),
                    headers={"Upload-Offset": str(offset)},
                )
                if answer.status_code == 202:
                    on_progress(1.0, "uploaded")
                    return answer.json()
                if answer.status_code == 204:
                    offset, failures = int(answer.headers["Upload-Offset"]), 0
                    on_progress(offset / size, f"{offset / 1e6:.1f} of {size / 1e6:.1f} MB")
                    continue
                if answer.status_code not in (409, 429, 500, 502, 503, 504):
                    raise _Refused(_problem(answer))
                reason = _problem(answer)
            except httpx.TransportError as error:
                reason = f"no answer from {client.base_url} ({error or type(error).__name__})"
            failures += 1
            if failures > _ATTEMPTS:
                raise UploadFailed(f"{reason}; run the same command to go on at {offset} bytes")
            sleep(_FIRST_PAUSE_S * 2**failures)
            offset = _offset(client, path, offset)


def _offset(client: httpx.Client, path: str, known: int) -> int:
    """How far the service says the upload is, or `known` while it does not answer."""
    try:
        answer = client.head(path)
    except httpx.TransportError:
        return known
    return int(answer.headers.get("Upload-Offset", known)) if answer.is_success else known


def _known_person(client: httpx.Client, person: str, height_m: float | None) -> str | None:
    people = _ask(client, "GET", "/v1/people")["items"]
    for one in people:
        if person in (one["id"], one["name"]):
            known = one.get("height_m")
            if height_m not in (None, known):
                has = "not known" if known is None else f"{known:g} m"
                raise UploadFailed(
                    "height_m must be told of somebody new, or be what they told before; got "
                    f"{height_m:g} for {one['name']}, whose height is {has}; leave it out, or name "
                    "somebody else"
                )
            return one["id"]
    return None


def _new_person(client: httpx.Client, name: str, height_m: float | None) -> str:
    about = {"name": name} if height_m is None else {"name": name, "height_m": height_m}
    return _ask(client, "POST", "/v1/people", json=about)["id"]


def _ask(client: httpx.Client, method: str, path: str, **options: Any) -> dict[str, Any]:
    try:
        answer = client.request(method, path, **options)
    except httpx.TransportError as error:
        raise UploadFailed(
            f"--to must be the address of a running service; got no answer from "
            f"{client.base_url} ({error or type(error).__name__})"
        ) from error
    if not answer.is_success:
        raise _Refused(_problem(answer))
    return answer.json()


def _problem(answer: httpx.Response) -> str:
    """What the service said, in its own words (RFC 9457) where it has any."""
    try:
        body = answer.json()
        return f"{body['title']} ({answer.status_code}): {body['detail']}"
    except (ValueError, KeyError, TypeError):
        return f"the service answered {answer.status_code}"


def _zipped(folder: Path, scratch: Path) -> Path:
    """The frames in `folder` as one zip: stored, since pictures do not shrink."""
    images = folder / "images" if (folder / "images").is_dir() else folder
    out = scratch / f"{folder.name}.zip"
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for file in sorted(p for p in images.iterdir() if p.is_file()):
            # a fixed date: the same frames must give the same bytes, or nothing could be resumed
            entry = zipfile.ZipInfo(file.name, (1980, 1, 1, 0, 0, 0))
            archive.writestr(entry, file.read_bytes())
    return out


def _sha256(file: Path) -> str:
    digest = hashlib.sha256()
    with file.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
