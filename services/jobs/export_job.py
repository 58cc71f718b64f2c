"""The job that makes a video of a recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from db.models import JobRow, RecordingExportRow
from db.repositories import UnitOfWork
from services.container import Services
from services.jobs.report import JobStopped, Reporter
from services.jobs.results import Results


def run_export(services: Services, job: JobRow, reporter: Reporter, folder: Path) -> None:
    """Export as the job's parameters say. Raises NotFound, InvalidInput, JobStopped."""
    from services.recording.replay import load
    from services.recording.video_export import export_video

    recording_id = str(job.params["recording_id"])
    recorded = load(services, recording_id)

    def on_progress(fraction: float) -> None:
        if reporter.should_stop():
            raise JobStopped
        reporter.progress(fraction, "filming", None)

    out = folder / "video.mp4"
    export_video(recorded, camera_path_of(job.params), out, on_progress)
    with Results(services, job) as results:
        stored = results.put_file(out)

        def write(unit: UnitOfWork, export: JobRow) -> str:
            unit.recordings.get(recording_id)
            unit.recordings.add_export(
                RecordingExportRow(
                    recording_id=recording_id,
                    job_id=export.id,
                    person_id=export.person_id,
                    bytes=stored.bytes,
                    sha256=stored.sha256,
                    shows=sorted(recorded.people),
                )
            )
            return "the video is ready"

        results.commit(write)


def camera_path_of(params: dict[str, Any]):
    """The camera as `services.api.recording_shapes.NewVideo` has it."""
    from services.recording.video_export import CameraKeyframe, CameraPath

    keyframes = [
        CameraKeyframe(float(one["at_s"]), tuple(one["position"]), tuple(one["target"]))
        for one in params["path"]
    ]
    fov_y_rad = math.radians(float(params["fov_deg"]))
    return CameraPath(keyframes, int(params["width"]), int(params["height"]), fov_y_rad)
