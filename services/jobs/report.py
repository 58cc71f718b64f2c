"""A running job's voice: progress, preview and checkpoint out; the wish to stop in.

Work calls `progress` as often as it likes; a thread writes the latest state a few times a second,
which is the job's heartbeat too, and learns by the way whether the job is still wanted.
"""

from __future__ import annotations

import logging
import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from db.errors import DatabaseError, NotFound
from db.objects import file_chunks
from scene.arrays import Array, Float
from services.container import Services
from services.jobs.events import job_topic
from services.jobs.lease import JobLease
from services.jobs.queue import drop_orphans

log = logging.getLogger(__name__)

BEAT_S = 0.4
_CHECKPOINT_EVERY_S = 5.0
_PREVIEW_SIDE_PX = 320


class JobStopped(Exception):
    """The job ended early because it should."""


class Reporter:
    """Speaks for one attempt at a job; use as a context manager."""

    def __init__(self, services: Services, lease: JobLease) -> None:
        self._services, self._lease = services, lease
        self._guard = threading.Lock()
        self._values: dict[str, Any] = {}
        self._preview: Array | None = None
        self._previews = 0
        self._checkpoint: Path | None = None
        self._checkpoint_seen = 0.0
        self._stop = threading.Event()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="heartbeat", daemon=True)

    def __enter__(self) -> Reporter:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._over.set()
        self._thread.join()

    def progress(
        self, fraction: float, message: str, preview: Float[Array, "H W 3"] | None = None
    ) -> None:
        """Say how far the work is."""
        with self._guard:
            self._values["progress"] = min(1.0, max(0.0, float(fraction)))
            self._values["message"] = message[:500]
        if preview is not None:
            self.show(preview)

    def show(self, preview: Float[Array, "H W 3"]) -> None:
        """Show what comes of the work."""
        with self._guard:
            self._preview = preview

    def watch_checkpoint(self, path: Path) -> None:
        """Keep what the work writes to `path` in the store, so that another may go on from it."""
        self._checkpoint_seen = path.stat().st_mtime if path.exists() else 0.0
        self._checkpoint = path

    def stop(self) -> None:
        """Ask the work to stop."""
        self._stop.set()

    def should_stop(self) -> bool:
        """Whether the work should stop now."""
        return self._stop.is_set()

    def save_checkpoint(self) -> None:
        """Store the checkpoint if it has changed since the last time."""
        path = self._checkpoint
        if path is None or not path.exists() or path.stat().st_mtime == self._checkpoint_seen:
            return
        self._checkpoint_seen = path.stat().st_mtime
        owner = self._lease.person_id
        stored = self._services.objects.put(owner, file_chunks(path))
        orphans = []
        with self._services.unit_of_work() as unit:
            before = unit.jobs.get(self._lease.job_id).checkpoint_sha256
            if before is not None and before != stored.sha256:
                orphans.append((owner, before))
            if not self._write(unit, {"checkpoint_sha256": stored.sha256}):
                orphans = [(owner, stored.sha256)]
            unit.commit()
        drop_orphans(self._services, orphans)

    def _beat(self) -> None:
        beats = 0
        every = round(_CHECKPOINT_EVERY_S / BEAT_S)
        while not self._over.wait(BEAT_S):
            beats += 1
            try:
                self._speak()
                if beats % every == 0:
                    self.save_checkpoint()
            except NotFound:
                self.stop()  # the job, or all of its person, was erased
            except DatabaseError as error:
                log.warning("the heartbeat was not heard: %s", error)

    def _speak(self) -> None:
        with self._guard:
            values, self._values = self._values, {}
            preview, self._preview = self._preview, None
        if preview is not None:
            self._previews += 1
            values |= {"preview": encode_preview(preview), "preview_version": self._previews}
        with self._services.unit_of_work() as unit:
            wanted = self._write(unit, values)
            wanted = wanted and not unit.jobs.get(self._lease.job_id).cancel_requested
            unit.commit()
        if not wanted:
            self.stop()
        if values:
            self._services.events.publish(job_topic(self._lease.job_id))

    def _write(self, unit: Any, values: dict[str, Any]) -> bool:
        values = values | {"heartbeat_at": self._services.clock()}
        return unit.jobs.write(self._lease.job_id, self._lease.attempt, values)


def encode_preview(picture: Float[Array, "H W 3"]) -> bytes:
    """PNG of an sRGB picture in [0, 1], at most 320 px a side."""
    height, width = picture.shape[:2]
    pixels = (np.clip(picture, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    scale = _PREVIEW_SIDE_PX / max(height, width)
    if scale < 1.0:
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".png", np.ascontiguousarray(pixels[..., ::-1]))[1].tobytes()
