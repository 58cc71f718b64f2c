"""Makes the demo's performer: `python -m tools.build_demo MOTION.bvh` (two minutes, two cores).

A studio performer is filmed while they talk, move to a recorded motion and turn once; the model
trained on those frames then plays the recording itself. The bundled file comes from CMU's trial
141_16, "Wave Hello" (mocap.cs.cmu.edu; see NOTICE).
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from capture.sources.bvh import read_bvh
from capture.storage import open_sequence
from capture.studio import make_sequence
from renderer.model_files import save_model
from renderer.presets import Preset, find_preset
from renderer.splats.settings import SplatSettings
from renderer.training import train
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from services.bootstrap import DEMO_MODEL
from services.cli.terminal import progress_bar
from services.live.room import facing_yaw

_FRAMES, _SIZE, _SEED, _ITERATIONS = 90, 512, 2, 6000
_SPLATS = 10_000
"""So that the file stays below a megabyte: it ships with the package."""


def build(
    motion: Annotated[Path, typer.Argument(help="Recorded motion (.bvh).")],
    out: Annotated[Path, typer.Option()] = DEMO_MODEL,
) -> None:
    """Film, train and store the demo's performer."""
    with tempfile.TemporaryDirectory() as folder, progress_bar("demo performer") as report:
        clip_folder = Path(folder) / "sequence"
        make_sequence(
            clip_folder,
            motion=motion,
            look="lit",
            frames=_FRAMES,
            size=_SIZE,
            seed=_SEED,
            expressions=True,
            on_progress=lambda done, message: report(0.3 * done, message),
        )
        clip = open_sequence(clip_folder)
        model = train(
            clip,
            preset=_preset(),
            iterations=_ITERATIONS,
            seed=_SEED,
            find_light=True,
            clock=time.perf_counter,
            on_progress=lambda step: report(0.3 + 0.7 * step.fraction, step.message),
        )
    splats = model.splats
    assert splats is not None
    recorded = _before_the_camera(read_bvh(motion, clip.body.skeleton))
    save_model(replace(splats, motion=recorded), out)


def _preset() -> Preset:
    return replace(find_preset("splats"), settings=SplatSettings(most=_SPLATS))


def _before_the_camera(motion: Motion) -> Motion:
    """`motion` with its mean place on the floor at x = z = 0, turned to face the clip's camera: so
    the clip's light falls on them from where it fell for that."""
    turn = axis_angle_to_matrix(np.array([0.0, facing_yaw(motion), 0.0]))
    angles = motion.joint_angles.copy()
    angles[:, 0] = matrix_to_axis_angle(turn @ axis_angle_to_matrix(angles[:, 0]))
    shift = motion.root_translation.mean(axis=0) * [1.0, 0.0, 1.0]
    root = (motion.root_translation - shift) @ turn.T
    return replace(motion, joint_angles=angles, root_translation=root)


if __name__ == "__main__":
    typer.run(build)
