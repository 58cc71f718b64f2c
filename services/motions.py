"""Stored motions: what a sequence's person did, free to move any model."""

from __future__ import annotations

import io

import numpy as np

from db.repositories import UnitOfWork
from scene.expression import values_of_any_version
from scene.motion import Motion
from services.container import Services
from services.errors import NotCaptured


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
    """The inverse of `motion_bytes`."""
    with np.load(io.BytesIO(data), allow_pickle=False) as stored:
        return Motion(
            stored["times_s"],
            stored["joint_angles"],
            stored["root_translation"],
            stored["confidence"],
            *([values_of_any_version(stored["expressions"])] if "expressions" in stored else []),
        )
