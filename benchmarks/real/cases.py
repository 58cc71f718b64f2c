"""Who is measured: real people, what is trained of them, and what it is judged on."""

from __future__ import annotations

from dataclasses import dataclass

ITERATIONS = 1500
"""Steps that each model is trained: as many on every machine, so that figures compare."""


@dataclass(frozen=True)
class Case:
    """One person in one training clip. Clips are named as their rulers are."""

    name: str
    trained: str
    """The clip that is captured and trained on."""
    trained_share: float = 1.0
    """The part of its frames, from the first, that training sees; the rest is judged."""
    other_clips: tuple[str, ...] = ()
    """More clips of the person: captured by themselves, never trained on."""
    other_cameras: tuple[str, ...] = ()
    """Calibrated cameras that filmed the same moments."""
    calibration: str | None = None
    """Their calibration, below the folder of footage."""


CASES = (
    Case("grey-shirt", "grey_shirt_sorry", other_clips=("grey_shirt_please", "grey_shirt_milk")),
    Case(
        "orange-hoodie",
        "orange_hoodie_book",
        other_clips=("orange_hoodie_walk", "orange_hoodie_learn"),
    ),
    Case(
        "patterned-shirt",
        "patterned_shirt_sister",
        other_clips=("patterned_shirt_night", "patterned_shirt_eat"),
    ),
    Case(
        "desk",
        "desk_cam2",
        0.42,
        other_cameras=("desk_cam1", "desk_cam3"),
        calibration="real-four-cameras/charuco_calibration/camera_array.toml",
    ),
    Case("juggler", "juggler", 0.8),
    Case(
        "walker",
        "walker_cam01",
        0.8,
        other_cameras=("walker_cam02",),
        calibration="real-two-cameras/Calib.qca.txt",
    ),
)
