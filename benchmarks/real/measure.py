"""Real people: a model of one clip, judged on frames that it never saw, by a frozen ruler.

Each case is captured and trained as the product does it. Its test frames are those of the clip
that training saw (`own_views`, in the poses that training left), later frames of the same clip
(`later_frames`), other clips of the person (`other_clips`) and other calibrated cameras
(`other_cameras`), each as given and, but for the first, aligned by its own picture.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from benchmarks.real.calibration import read_calibration
from benchmarks.real.cases import CASES, Case
from benchmarks.real.filmed import FilmedClip, film, require_unseen
from benchmarks.real.frames import OWN_VIEWS, test_frames
from benchmarks.real.judge import Figures, Judge, TestFrame, flicker, mean
from benchmarks.real.parts import part_finder
from benchmarks.real.posture import head_level_deg, head_pitch_deg, trunk_lean_deg
from benchmarks.real.ruler import Ruler
from benchmarks.real.sheet import draw_sheet
from benchmarks.reporting.figures import FigureWriter
from capture.pipeline import CaptureOptions
from renderer.evaluation.lpips import Lpips
from renderer.evaluation.pose_alignment import Aligner
from renderer.performer_model import PerformerModel
from renderer.training import train
from scene.motion import Pose
from scene.sequence import Frame, Sequence

_REPORTED = ("landmark_error_px", "landmark_error_mm", "mask_overlap", "person_px")


@dataclass(frozen=True)
class Networks:
    """Files that a measurement needs."""

    pose: Path
    face: Path
    hand: Path
    lpips: Path


def run(
    writer: FigureWriter,
    footage: Path,
    networks: Networks,
    iterations: int,
    only: str = "",
    cases: tuple[Case, ...] = CASES,
) -> None:
    """Measure what was not measured yet of `cases`, draw a sheet of each, and report."""
    cache = writer.cache(only)
    conditions = {"lpips": networks.lpips.name, "iterations": iterations}
    rows: dict[str, Any] = {}
    for case in cases:
        sheet = writer.picture(f"{case.name}.jpg")
        found = cache.measured(
            case.name,
            {"case": asdict(case), **conditions},
            lambda c=case, s=sheet: measure(c, footage, networks, iterations, s),
        )
        if found is not None:
            rows[case.name] = found
    writer.write({**conditions, "cases": rows})


def measure(
    case: Case, footage: Path, networks: Networks, iterations: int, sheet: Path
) -> dict[str, Any]:
    """The figures of one case; its contact sheet is written to `sheet`."""
    face_and_hand = part_finder(networks.face, networks.hand)
    with tempfile.TemporaryDirectory() as folder, face_and_hand as finder:
        judge = Judge(Lpips(networks.lpips), finder)
        clips = captured_clips(case, footage, networks, Path(folder))
        clip = clips[case.trained]
        part, numbers = clip.training_part(case.trained_share)
        begun = time.perf_counter()
        model = trained_model(part, iterations)
        training_s = time.perf_counter() - begun
        frames = list(test_frames(case, clips, model, set(numbers), footage))
        require_unseen(
            (clip.footage.images[number] for number in numbers),
            (frame.image for frame in frames if frame.group != OWN_VIEWS),
        )
        aligner = Aligner(model, part)
        aligned = [
            frame if frame.group == OWN_VIEWS else replace(frame, pose=_aligned(aligner, frame))
            for frame in frames
        ]
        draw_sheet(sheet, model, frames, aligned)
        return {
            "clips": {
                name: {
                    "frames": len(one.footage.images),
                    "seconds": round(one.footage.times_s[-1], 2),
                    "capture_s": round(one.capture_s, 1),
                    **{key: one.report[key] for key in _REPORTED},
                    **_posture(one),
                }
                for name, one in clips.items()
            },
            "trained_frames": len(numbers),
            "training_s": round(training_s, 1),
            "splats": None if model.splats is None else len(model.splats),
            "as_given": _summary(judge, model, frames),
            "aligned": _summary(judge, model, [f for f in aligned if f.group != OWN_VIEWS]),
        }


def captured_clips(
    case: Case, footage: Path, networks: Networks, folder: Path
) -> dict[str, FilmedClip]:
    """The clip that is trained on and the others of the person, captured into `folder`."""
    return {
        name: film(
            Ruler.read(name),
            footage,
            folder / name,
            capture_options(case, name, footage, networks),
        )
        for name in dict.fromkeys((case.trained, *case.other_clips))
    }


def trained_model(part: Sequence, iterations: int) -> PerformerModel:
    """A model of `part` as the product trains it."""
    return train(
        part,
        preset="splats",
        iterations=iterations,
        find_light=True,
        size="auto",
        clock=time.perf_counter,
    )


def _posture(clip: FilmedClip) -> dict[str, float]:
    """Means over the clip's frames."""
    motion, skeleton = clip.sequence.motion, clip.sequence.body.skeleton
    found = {
        "trunk_lean_deg": trunk_lean_deg(motion, skeleton),
        "head_pitch_deg": head_pitch_deg(motion, skeleton, clip.camera),
        "head_level_deg": head_level_deg(motion, skeleton),
    }
    return {name: round(float(values.mean()), 1) for name, values in found.items()}


def capture_options(case: Case, clip: str, footage: Path, networks: Networks) -> CaptureOptions:
    focal_px = None
    if case.calibration is not None:
        focal_px = float(read_calibration(footage / case.calibration, clip).intrinsics[0, 0])
    return CaptureOptions(
        person=case.name,
        pose_model=networks.pose,
        face_model=networks.face,
        hand_model=networks.hand,
        focal_px=focal_px,
    )


def _aligned(aligner: Aligner, frame: TestFrame) -> Pose:
    return aligner.align(Frame(frame.truth, frame.mask, frame.camera, frame.pose))


def _summary(judge: Judge, model: PerformerModel, frames: list[TestFrame]) -> dict[str, Any]:
    """Means over the frames of each group, and of each clip in it."""
    summary: dict[str, Any] = {}
    for group in dict.fromkeys(frame.group for frame in frames):
        members = [frame for frame in frames if frame.group == group]
        figures = [
            judge.figures(model.render(frame.camera, frame.pose), frame) for frame in members
        ]
        summary[group] = means(figures) | {"flicker": _flicker(model, members)}
        clips = dict.fromkeys(frame.clip for frame in members)
        summary[group]["clips"] = {
            clip: means(
                [f for f, frame in zip(figures, members, strict=True) if frame.clip == clip]
            )
            for clip in clips
        }
    return summary


def means(figures: list[dict[str, Figures]]) -> dict[str, Any]:
    """Of each part's figures over frames; how many frames."""
    names = {part: dict.fromkeys(n for one in figures for n in one[part]) for part in figures[0]}
    return {"frames": len(figures)} | {
        part: {
            name: None
            if (value := mean(one[part].get(name) for one in figures)) is None
            else round(value, 4)
            for name in names[part]
        }
        for part in names
    }


def _flicker(model: PerformerModel, frames: list[TestFrame]) -> float | None:
    pairs = [
        (early, late)
        for early, late in pairwise(frames)
        if late.clip == early.clip and late.index == early.index + 1
    ]
    found = mean(flicker(model, *pair) for pair in pairs)
    return None if found is None else round(found, 3)
