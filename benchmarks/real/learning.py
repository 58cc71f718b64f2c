"""Learning while one talks: whether a model gets better by pictures that its live look keeps.

A model is made of one clip. The first half of each other clip of the person (of the juggler, who
turns away at the end, of the rest of his clip) plays as a webcam's video: landmarks, live motion,
cut-outs, VP8 and what the server keeps of them are the product's own (`served_webcam`). With
what was kept the model goes on to learn as the product has it, held to its clip, for a third of the
steps. The models of before and after are judged on the second halves, each in the pose that flow
aligns it in with the frame's own picture, as in live look.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.real.cases import CASES, Case
from benchmarks.real.filmed import FilmedClip
from benchmarks.real.frames import Retarget, test_frame
from benchmarks.real.judge import Judge, TestFrame
from benchmarks.real.measure import Networks, captured_clips, means, trained_model
from benchmarks.real.parts import part_finder
from benchmarks.real.served_webcam import ServedWebcam
from benchmarks.reporting.measurements import MeasurementCache
from capture.storage import open_sequence
from renderer.errors import ForgotTooMuch
from renderer.evaluation.lpips import Lpips
from renderer.live_look.frame_keeper import KeptFrame, sides_shown
from renderer.live_look.learning import with_kept
from renderer.live_look.live_look import LiveLook
from renderer.live_look.picture import WebcamPicture
from renderer.performer_model import PerformerModel
from renderer.training import train
from scene.arrays import Array, UInt8
from scene.sequence import Sequence, body_crop
from services.jobs.kept_frames import BUDGET_S, side_words, write_kept
from services.joining.finder import PersonFinder

LEARNING_CASES = tuple(case for case in CASES if case.other_clips or case.name == "juggler")
_CAMERA_PX = 640
"""Longer side of what a page asks of a camera."""
_TRAINED_S = 60.0
"""A clip is trained for so long, unless somebody says otherwise: what is kept, for `BUDGET_S`."""
_ALIGNED_PX, _MARGIN = 384, 0.1
"""Longer side of the picture that a pose is aligned with, and what is round the person in it."""
_GROUP = "other_half"


def measure_learning(
    cache: MeasurementCache, footage: Path, networks: Networks, iterations: int
) -> dict[str, Any]:
    """Measure who was not measured yet; the figures of all, by name."""
    conditions = {"iterations": iterations, "lpips": networks.lpips.name}
    found = {
        case.name: cache.measured(
            f"learning-{case.name}",
            {"case": asdict(case), **conditions},
            lambda c=case: measure(c, footage, networks, iterations),
        )
        for case in LEARNING_CASES
    }
    return {name: figures for name, figures in found.items() if figures is not None}


def measure(case: Case, footage: Path, networks: Networks, iterations: int) -> dict[str, Any]:
    """The figures of one case."""
    face_and_hand = part_finder(networks.face, networks.hand)
    with tempfile.TemporaryDirectory() as folder, face_and_hand as finder:
        judge = Judge(Lpips(networks.lpips), finder)
        clips = captured_clips(case, footage, networks, Path(folder))
        part, numbers = clips[case.trained].training_part(case.trained_share)
        before = trained_model(part, iterations)
        assert before.splats is not None
        later = _later(case, clips, max(numbers) + 1)
        seen = 0
        with ServedWebcam(before.splats) as webcam:
            for clip, first, half in later:
                with PersonFinder(networks.pose, networks.face, networks.hand) as person:
                    seen += webcam.play(person, _played(clip, first, half))
            kept = webcam.kept
        after, forgot = _learnt(part, kept, before, iterations, Path(folder) / "kept")
        return {
            "seen": seen,
            "kept": len(kept),
            "sides": [side_words(side) for side in sides_shown(kept)],
            "forgot": forgot,
            "held_to": after.metrics.get("held_to"),
            **{
                name: means(list(_judged(judge, model, case, later)))
                for name, model in (("before", before), ("after", after))
            },
        }


def _later(
    case: Case, clips: dict[str, FilmedClip], untrained: int
) -> list[tuple[FilmedClip, int, int]]:
    """Clips, where they begin to play, and where their second half begins: numbers of frames."""
    if not case.other_clips:
        clip = clips[case.trained]
        return [(clip, untrained, (untrained + len(clip.footage.images)) // 2)]
    others = (clips[name] for name in case.other_clips)
    return [(clip, 0, len(clip.footage.images) // 2) for clip in others]


def _played(clip: FilmedClip, first: int, half: int) -> Iterator[tuple[float, UInt8[Array, "..."]]]:
    """Seconds and pictures of the first half, as large as a page asks of a camera."""
    for index in range(first, half):
        image = clip.footage.images[index]
        scale = min(1.0, _CAMERA_PX / max(image.shape[:2]))
        small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        yield float(clip.footage.times_s[index]), small


def _learnt(
    clip: Sequence, kept: list[KeptFrame], before: PerformerModel, iterations: int, folder: Path
) -> tuple[PerformerModel, str | None]:
    """The model after the round, and why it stays as it was; as `services.jobs.train_job` does."""
    if not kept:
        return before, None
    assert before.splats is not None
    write_kept(folder, before.splats, kept)
    lesson = with_kept(clip, [open_sequence(folder)], before)
    steps = max(1, round(iterations * BUDGET_S / _TRAINED_S))
    try:
        after = train(
            lesson,
            preset="splats",
            iterations=steps,
            start=before,
            find_light=True,
            held_to=len(clip.train),
            clock=time.perf_counter,
        )
    except ForgotTooMuch as error:
        return before, str(error)
    return after, None


def _judged(
    judge: Judge, model: PerformerModel, case: Case, later: list[tuple[FilmedClip, int, int]]
) -> Iterator[dict[str, Any]]:
    """Of each judged frame of the second halves."""
    for clip, _, half in later:
        for index in clip.ruler.indices:
            if index < half:
                continue
            frame = _aligned(_placed(clip, index, model, case), model)
            yield judge.figures(model.render(frame.camera, frame.pose), frame)


def _aligned(frame: TestFrame, model: PerformerModel) -> TestFrame:
    """In the pose in which live look would show it, were it the first picture."""
    window, splats = body_crop(frame.mask, _MARGIN), model.splats
    if window is None or splats is None:
        return frame
    rows, columns = window
    width, height = columns.stop - columns.start, rows.stop - rows.start
    picture = WebcamPicture(
        np.ascontiguousarray(frame.image[window]),
        np.rint(255.0 * frame.mask[window]).astype(np.uint8),
        frame.camera.cropped(columns.start, rows.start, width, height),
        frame.pose,
    ).resized(min(1.0, _ALIGNED_PX / max(width, height)))
    return replace(frame, pose=LiveLook(splats).align(picture).pose)


def _placed(clip: FilmedClip, index: int, model: PerformerModel, case: Case) -> TestFrame:
    """A frame in the model's world."""
    camera, pose = clip.camera, clip.pose(index)
    if case.other_clips:
        retarget = Retarget.between(clip, model)
        camera, pose = retarget.camera(camera), retarget.pose(pose)
    return test_frame(clip, _GROUP, index, camera, pose)
