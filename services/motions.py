"""Stored motions: what a sequence's person did, free to move any model."""

from __future__ import annotations

import io
import zipfile
import zlib

import numpy as np

from db.repositories import UnitOfWork
from scene.errors import InvalidInput
from scene.expression import values_of_any_version
from scene.motion import Motion
from services.container import Services
from services.errors import NotCaptured

_ARRAYS = ("times_s", "joint_angles", "root_translation", "confidence")
_BROKEN = (ValueError, EOFError, OSError, NotImplementedError, zipfile.BadZipFile, zlib.error)


def motion_of(services: Services, unit: UnitOfWork, sequence_id: str) -> Motion:
    """The motion of a sequence. Raises NotCaptured as long as it has none."""
    row = unit.motions.of_sequence(sequence_id)
    if row is None:
        raise NotCaptured(
            "motion_sequence_id must be of a sequence that is ready; got "
            f"{sequence_id!r}; wait for its capture",
        )
    return motion_from_bytes(b"".join(services.objects.stream(row.person_id, row.sha256)))


def motion_bytes(motion: Motion) -> bytes:
    """A motion as `motion.npz` of a sequence folder."""
    file = io.BytesIO()
    np.savez_compressed(
        file,
        times_s=motion.times_s,
        joint_angles=motion.joint_angles,
        root_translation=motion.root_translation,
        confidence=motion.confidence,
        expressions=motion.expressions,
    )
    return file.getvalue()


def motion_from_bytes(data: bytes) -> Motion:
    """The inverse of `motion_bytes`. Raises InvalidInput for other bytes."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            stored = {name: np.asarray(file[name]) for name in file}
    except _BROKEN as error:
        raise InvalidInput(f"a stored motion must be a whole .npz; got {error}") from error
    missing = [name for name in _ARRAYS if name not in stored]
    if missing:
        raise InvalidInput(f"a stored motion must hold {', '.join(_ARRAYS)}; got no {missing[0]}")
    arrays = [stored[name] for name in _ARRAYS]
    if "expressions" in stored:
        arrays.append(values_of_any_version(stored["expressions"]))
    return Motion(*arrays)
