"""Real sequences and models, made small, and put where an upload and its capture would put them."""

from __future__ import annotations

import hashlib
import io
import subprocess
import sys
import zipfile
from functools import cache
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from capture.storage import open_sequence
from capture.studio import make_sequence
from db.models import (
    JobKind,
    ModelFileRow,
    ModelRow,
    MotionRow,
    PersonRow,
    SequenceKind,
    SequenceRow,
    SequenceState,
    new_id,
)
from renderer.performer_model import PerformerModel
from services import bootstrap
from services.container import Services
from services.jobs.packing import pack
from services.jobs.queue import enqueue
from services.person_models import write_files
from tests.shared_data import shared_data


def film(folder: Path) -> Path:
    """A studio sequence of 8 frames of 64 px."""
    make_sequence(folder, frames=8, size=64, test_cameras=1)
    return folder


_TRAIN = """
import sys, time
from pathlib import Path
from capture.storage import open_sequence
from renderer.model_files import save_model
from renderer.training import train
model = train(open_sequence(Path(sys.argv[1])), iterations=5, clock=time.perf_counter)
save_model(model, Path(sys.argv[2]))
"""


def train(folder: Path, out: Path) -> Path:
    """A model of five steps, trained in a process of its own as jobs are."""
    subprocess.run([sys.executable, "-c", _TRAIN, str(folder), str(out)], check=True)
    return out


def captured(services: Services, folder: Path, account: str = "house") -> SequenceRow:
    """A person with a captured sequence, as after an upload and its capture."""
    now = services.clock()
    person = PersonRow(id=new_id(), account=account, name="Ada", created_at=now)
    clip = open_sequence(folder)
    source = services.objects.put(person.id, [b"the clip"])
    packed = pack(services.objects, person.id, folder)
    motion = services.objects.put(person.id, [(folder / "motion.npz").read_bytes()])
    sequence = SequenceRow(
        id=new_id(),
        person_id=person.id,
        kind=SequenceKind.VIDEO,
        state=SequenceState.READY,
        created_at=now,
        source_name="clip.mp4",
        source_sha256=source.sha256,
        packed_sha256=packed.sha256,
        frames=len(clip.train),
        frames_per_second=clip.frames_per_second,
        duration_s=clip.motion.duration_s,
    )
    with services.unit_of_work() as unit:
        unit.people.add(person)
        unit.flush()
        unit.sequences.add(sequence)
        unit.flush()
        unit.motions.add(
            MotionRow(
                person_id=person.id,
                sequence_id=sequence.id,
                frames=len(clip.motion),
                duration_s=clip.motion.duration_s,
                sha256=motion.sha256,
            )
        )
        unit.commit()
    return sequence


_WRITTEN: dict[str, dict[str, bytes]] = {}
"""The files by which a model is handed out, by the sha256 of the file that it came in."""


def imported(services: Services, path: Path, account: str, name: str) -> ModelRow:
    """As `import_model`, of files that are made once: the viewer's takes half a second."""
    digest = hashlib.sha256(path.read_bytes()).hexdigest()

    def written(model: PerformerModel, folder: Path) -> list[Path]:
        if digest not in _WRITTEN:
            _WRITTEN[digest] = {one.name: one.read_bytes() for one in write_files(model, folder)}
        for file, content in _WRITTEN[digest].items():
            (folder / file).write_bytes(content)
        return [folder / file for file in _WRITTEN[digest]]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bootstrap, "write_files", written)
        return bootstrap.import_model(services, path, account, name)


def with_clip(services: Services, model: Path, clip: Path, account: str = "house") -> ModelRow:
    """The model in the file `model`, of Ada, whose sequence is stored from the folder `clip`."""
    row = imported(services, model, account, "Ada")
    packed = pack(services.objects, row.person_id, clip)
    sequence = SequenceRow(
        id=new_id(),
        person_id=row.person_id,
        kind=SequenceKind.VIDEO,
        state=SequenceState.READY,
        created_at=services.clock(),
        source_name="clip.mp4",
        source_sha256=packed.sha256,
        packed_sha256=packed.sha256,
    )
    with services.unit_of_work() as unit:
        unit.sequences.add(sequence)
        unit.flush()
        unit.models.get(row.id).sequence_id = sequence.id
        unit.commit()
    return row


def uploaded(services: Services, state: SequenceState = SequenceState.UPLOADED) -> SequenceRow:
    """A person with a clip that no job can read, whatever its `state`: its bytes are nowhere."""
    now = services.clock()
    person = PersonRow(id=new_id(), account="house", name="Ada", created_at=now)
    clip = SequenceRow(
        id=new_id(),
        person_id=person.id,
        kind=SequenceKind.VIDEO,
        state=state,
        created_at=now,
        source_name="none.mp4",
        source_sha256="0" * 64,
    )
    with services.unit_of_work() as unit:
        unit.people.add(person)
        unit.flush()
        unit.sequences.add(clip)
        unit.commit()
    return clip


def trained(services: Services, sequence: SequenceRow) -> ModelRow:
    """A model of `sequence`, with a file."""
    weights = services.objects.put(sequence.person_id, [b"the model"])
    with services.unit_of_work() as unit:
        model = ModelRow(
            id=new_id(),
            person_id=sequence.person_id,
            sequence_id=sequence.id,
            preset="splats",
            created_at=services.clock(),
            data_hash="0" * 64,
            metrics={},
        )
        unit.models.add(model)
        unit.flush()
        file = {"name": "model.safetensors", "bytes": weights.bytes, "sha256": weights.sha256}
        model.files = [ModelFileRow(person_id=sequence.person_id, **file)]
        unit.commit()
    return model


def queued_training(services: Services, sequence: SequenceRow, budget_s: float = 2.0) -> str:
    """A training in the queue; its job's id."""
    with services.unit_of_work() as unit:
        params = {"preset": "splats", "budget_s": budget_s, "seed": 0}
        job = enqueue(unit, JobKind.TRAIN, sequence, params, services.clock())
        unit.commit()
    return job.id


def picture(seed: int = 0, size: int = 32) -> bytes:
    """A PNG of noise."""
    pixels = np.random.default_rng(seed).integers(0, 255, (size, size, 3), dtype=np.uint8)
    return cv2.imencode(".png", pixels)[1].tobytes()


def archive(entries: dict[str, bytes], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A zip with these entries."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as made:
        for name, data in entries.items():
            made.writestr(name, data)
    return file.getvalue()


@cache
def real_frames(count: int = 8, height: int = 300) -> bytes:
    """Every tenth frame of a real clip, small, as a zip."""
    entries = {}
    with av.open(str(shared_data("real-two-cameras/cam01.mp4"))) as container:
        for index, frame in enumerate(container.decode(video=0)):
            if index % 10 == 0:
                pixels = frame.to_ndarray(format="bgr24")
                width = round(pixels.shape[1] * height / pixels.shape[0])
                small = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
                entries[f"{index:04d}.jpg"] = cv2.imencode(".jpg", small)[1].tobytes()
            if len(entries) == count:
                break
    return archive(entries)


def frames_archive(count: int = 10) -> bytes:
    """A zip of frames without anybody in them."""
    return archive({f"{i:03d}.png": picture(i) for i in range(count)})


def video(frames: int = 12, size: int = 64) -> bytes:
    """An mp4 of noise: a video without a person."""
    file = io.BytesIO()
    rng = np.random.default_rng(0)
    with av.open(file, "w", format="mp4") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.width = stream.height = size
        stream.pix_fmt = "yuv420p"
        for _ in range(frames):
            pixels = rng.integers(0, 255, (size, size, 3), dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels)))
        container.mux(stream.encode())
    return file.getvalue()


def keypoints(frames: int = 3, angle: float = 0.1) -> dict:
    """Keypoints that lift the arms."""
    joints = [[0.0, 0.0, angle] for _ in range(24)]
    return {
        "format": "metanerf-keypoints",
        "version": 1,
        "layout": "smpl24",
        "frames_per_second": 30,
        "frames": [{"joint_angles": joints} for _ in range(frames)],
    }
