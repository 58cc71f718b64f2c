"""How soon somebody who has sent a clip is met: by a first likeness, and by the finished model.

A demo in a process of its own, with the one worker that it has; the training is queued as soon as
the clip is sent, as the page does. Seconds are wall clock from the last byte. Then the same once
more while somebody looks at a meeting on the same machine, by the server's pictures: what is live
comes first.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx

from benchmarks.browser import open_page, running_demo
from benchmarks.meeting import SIZE_PX, driven, look, watched
from benchmarks.reporting.figures import FigureWriter
from capture.sources.video import probe_video
from services.api.shapes import NewModel

_LOOK_S = 0.1
_JSON = dict[str, Any]


@dataclass
class Timeline:
    """When what came of a clip, s."""

    captured_s: float | None = None
    models: list[tuple[float, str]] = field(default_factory=list)
    """Each with its id, the first likeness first."""

    def note(self, now_s: float, capture: _JSON, training: _JSON) -> None:
        """What the jobs say at `now_s`. Raises RuntimeError where one has failed."""
        for job in (capture, training):
            if job["state"] == "failed":
                raise RuntimeError(f"the {job['kind']} must succeed; got {job['message']}")
        model_id = training["model_id"]
        if model_id is not None and model_id not in [known for _, known in self.models]:
            self.models.append((now_s, model_id))
        if self.captured_s is None and capture["state"] == "succeeded":
            self.captured_s = now_s

    def figures(self) -> _JSON:
        """Rounded to tenths; no first likeness where the capture was over before any model."""
        if self.captured_s is None or not self.models:
            raise RuntimeError(f"a clip must become a model; got {self}")
        times_s = [round(time_s, 1) for time_s, _ in self.models]
        early = times_s[0] < self.captured_s
        return {
            "first_likeness_s": times_s[0] if early else None,
            "captured_s": round(self.captured_s, 1),
            "rounds_s": times_s[early:],
            "model_s": times_s[-1],
        }


def run(writer: FigureWriter, clips: list[Path]) -> None:
    """Measure each clip on a demo of its own, and report."""
    rows = [
        {"clip": clip.name, **_about(clip), **_enrolled(clip), "viewer": _looked_on(clip)}
        for clip in clips
    ]
    writer.write({"budget_s": NewModel().budget_s, "rows": rows})


def _about(clip: Path) -> _JSON:
    info = probe_video(clip)
    seconds = round(info.frames / info.frames_per_second, 1)
    return {"seconds": seconds, "size": [info.width, info.height]}


def _enrolled(clip: Path) -> _JSON:
    with (
        tempfile.TemporaryDirectory() as folder,
        running_demo(Path(folder)) as address,
        httpx.Client(base_url=f"{address}v1", timeout=60.0) as client,
    ):
        jobs = _sent(client, clip)
        begun_s = time.monotonic()
        timeline = Timeline()
        for capture, training in _watched(client, *jobs):
            timeline.note(time.monotonic() - begun_s, capture, training)
            time.sleep(_LOOK_S)
        return timeline.figures()


def _looked_on(clip: Path) -> _JSON:
    """What one viewer of a meeting sees in a browser beside: before, and while the clip is captured
    and trained on."""
    seen: dict[str, list[_JSON]] = {"alone": [], "capture": [], "train": []}
    with driven(1) as meeting, open_page(SIZE_PX, SIZE_PX) as page:
        look(page, meeting, SIZE_PX)
        seen["alone"].append(watched(meeting, [page]))
        with httpx.Client(base_url=f"{meeting.address}v1", timeout=60.0) as client:
            for capture, training in _watched(client, *_sent(client, clip)):
                running = [job["kind"] for job in (capture, training) if job["state"] == "running"]
                found = watched(meeting, [page])
                if running:
                    seen[running[0]].append(found)
    return {doing: _typical(found) for doing, found in seen.items() if found}


def _typical(found: list[_JSON]) -> _JSON:
    """Of all looks: pictures a second, and how wide they were."""
    return {
        "looks": len(found),
        "frames_per_second": statistics.median(one["frames_per_second"] for one in found),
        "frames_per_second_worst": min(one["frames_per_second"] for one in found),
        "shown_px": min(one["shown_px"][0] for one in found),
    }


def _sent(client: httpx.Client, clip: Path) -> tuple[str, str]:
    """A guest has sent the clip and asked for a model: the jobs of capture and training."""
    client.headers["Authorization"] = f"Bearer {_asked(client, '/guest')['token']}"
    person = _asked(client, "/people", json={"name": "Ada"})
    files = {"file": (clip.name, clip.read_bytes())}
    sequence = _asked(client, f"/people/{person['id']}/sequences", files=files)
    wanted = {"preset": "splats"}
    training = _asked(client, f"/sequences/{sequence['id']}/models", json=wanted)
    return sequence["job_id"], training["id"]


def _asked(client: httpx.Client, path: str, **body: Any) -> _JSON:
    return client.post(path, **body).raise_for_status().json()


def _watched(client: httpx.Client, *job_ids: str) -> Iterator[list[_JSON]]:
    """The jobs, again and again until the last has ended."""
    while True:
        jobs = [client.get(f"/jobs/{one}").raise_for_status().json() for one in job_ids]
        yield jobs
        if jobs[-1]["state"] in ("succeeded", "failed", "cancelled"):
            return
