"""An upload and a training that go on while something fails, and what was lost of them."""

from __future__ import annotations

import hashlib
import io
import tempfile
import threading
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np

from benchmarks.faults.house import ACCOUNT, House
from capture.errors import UploadFailed
from capture.upload import upload

BUDGET_S = 6.0
"""Of each training."""
_PICTURES, _PICTURE_PX = 24, 256
PIECE_PAUSE_S = 1.0
"""After each piece, so that an upload goes on for some seconds."""
_AGAIN_S = 1.0
_AT_WORST_S = 600.0
_OVER = ("succeeded", "failed", "cancelled")


@dataclass
class Ledger:
    """What the service has said it keeps."""

    house: House
    kept: dict[str, str] = field(default_factory=dict)
    """By the path of a sequence or model: the sha256 that it was said to have."""

    def lost(self) -> list[str]:
        """What it does not have any more, or not whole: none where nothing was lost.

        Every row that somebody could see names objects that are there whole, too.
        """
        from db.backup import back_up

        services, gone = self.house.services, []
        for path, sha256 in self.kept.items():
            answer = httpx.get(self.house.host.address + path, headers=self.house.header)
            if answer.status_code != 200 or answer.json()["sha256"] != sha256:
                gone.append(path)
        with tempfile.TemporaryDirectory() as folder:
            archive = Path(folder) / "all.tar"
            now = services.clock()
            manifest = back_up(services.database, services.objects, archive, now, timedelta(days=1))
        return [*gone, *manifest.lost]


@dataclass
class Film:
    """A studio sequence that is trained from, stored as after its capture."""

    folder: Path
    person_id: str
    sequence_id: str

    @classmethod
    def stored(cls, house: House, folder: Path) -> Film:
        """Made in `folder` and stored in `house`."""
        from capture.studio import make_sequence
        from db.models import PersonRow, SequenceKind, SequenceRow, SequenceState, new_id
        from services.jobs.packing import pack

        make_sequence(folder, frames=24, size=96, test_cameras=2)
        services, now = house.services, house.services.clock()
        person = PersonRow(id=new_id(), account=ACCOUNT, name="Bo", created_at=now)
        source = services.objects.put(person.id, [b"a clip"])
        sequence = SequenceRow(
            id=new_id(),
            person_id=person.id,
            kind=SequenceKind.VIDEO,
            state=SequenceState.READY,
            created_at=now,
            source_name="clip.mp4",
            source_sha256=source.sha256,
            packed_sha256=pack(services.objects, person.id, folder).sha256,
        )
        with services.unit_of_work() as unit:
            unit.people.add(person)
            unit.flush()
            unit.sequences.add(sequence)
            unit.commit()
        return cls(folder, person.id, sequence.id)

    def psnr(self, house: House, model_id: str) -> float:
        """Of a model that was trained from it, in new views, dB."""
        from capture.storage import open_sequence
        from renderer.evaluation.evaluate import evaluate

        model = house.services.models.load(model_id)
        found = evaluate(model, open_sequence(self.folder))
        return float(found["psnr"]["novel_view"]["body_crop"])


class Work:
    """One training and one upload, from their beginning."""

    def __init__(self, ledger: Ledger, film: Film, number: int) -> None:
        self._ledger, self._film, self._house = ledger, film, ledger.house
        self._interruptions: list[str] = []
        body = {"preset": "splats", "budget_s": BUDGET_S}
        path = f"/v1/sequences/{film.sequence_id}/models"
        self.job_id = str(self._ask("POST", path, json=body)["id"])
        self._sequence: dict[str, Any] | None = None
        self._uploading = threading.Thread(target=self._upload, args=(number,), daemon=True)

    def under_way(self) -> None:
        """Return once the training has learnt something, and a part of the upload has come."""
        self._until(lambda job: job["progress"] > 0.1)
        self._uploading.start()
        time.sleep(2.0 * PIECE_PAUSE_S)

    def end(self) -> dict[str, Any]:
        """Wait for both ends: how the job ended, its model's quality, and what was kept."""
        job = self._until(lambda job: job["state"] in _OVER)
        resumed = job["state"] == "failed"
        told = job["error"]["status"] if job["error"] else None
        if resumed:
            self._ask("POST", f"/v1/jobs/{self.job_id}/resume")
            job = self._until(lambda job: job["state"] in _OVER)
        self._uploading.join(_AT_WORST_S)
        kept = self._ledger.kept
        if self._sequence is not None:
            kept[f"/v1/sequences/{self._sequence['id']}"] = self._sequence["sha256"]
        psnr = None
        if job["state"] == "succeeded":
            path = f"/v1/models/{job['model_id']}"
            kept[path] = self._ask("GET", path)["sha256"]
            psnr = round(self._film.psnr(self._house, job["model_id"]), 2)
        with self._house.services.reading() as unit:
            row = unit.jobs.get(self.job_id)
        return {
            "job": job["state"],
            "job_told": told,
            "job_resumed_by_hand": resumed,
            "job_attempts": row.attempt,
            "psnr": psnr,
            "upload": "whole" if self._sequence is not None else "not ended",
            "upload_interruptions": self._interruptions,
        }

    def _upload(self, number: int) -> None:
        """As `metanerf upload`, called again where it gives up."""
        data, deadline = _pictures(number), time.monotonic() + _AT_WORST_S
        wanted = hashlib.sha256(data).hexdigest()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "clip.zip"
            path.write_bytes(data)
            while self._sequence is None and time.monotonic() < deadline:
                try:
                    found = upload(
                        path,
                        self._house.host.address,
                        self._film.person_id,
                        self._house.host.token,
                        on_progress=lambda *_: time.sleep(PIECE_PAUSE_S),
                    )
                    assert found["sha256"] == wanted
                    self._sequence = found
                except UploadFailed as error:
                    self._interruptions.append(str(error)[:60])
                    time.sleep(_AGAIN_S)

    def _until(self, fits: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        deadline = time.monotonic() + _AT_WORST_S
        while True:
            try:
                job = self._ask("GET", f"/v1/jobs/{self.job_id}")
                if fits(job):
                    return job
            except (httpx.HTTPError, KeyError):  # the gateway, or what is behind it, is away
                pass
            if time.monotonic() > deadline:
                raise RuntimeError(f"job {self.job_id} must get on; got one that did not")
            time.sleep(0.2)

    def _ask(self, method: str, path: str, **options: Any) -> dict[str, Any]:
        answer = httpx.request(
            method, self._house.host.address + path, headers=self._house.header, **options
        )
        answer.raise_for_status()
        return answer.json()


def _pictures(number: int) -> bytes:
    """A zip of frames of noise, which shrinks little: some MB, others for each number."""
    random, out = np.random.default_rng(number), io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for frame in range(_PICTURES):
            picture = random.integers(0, 256, (_PICTURE_PX, _PICTURE_PX, 3), np.uint8)
            archive.writestr(f"{frame:02d}.png", cv2.imencode(".png", picture)[1].tobytes())
    return out.getvalue()
