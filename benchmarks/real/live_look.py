"""Live look on real people: the model of one clip, coloured by the frames of another.

The other clip plays as a webcam would send it: cut-out pictures of at most 384 px, 10 a second,
coded by VP8, with poses as captured. Its judged frames are shown at the webcam's own place, by the
model alone and with live look, both in the pose that the picture was aligned to. At the desk the
later frames of the clip itself are played, and what comes of them is judged by the other cameras,
in the poses given.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.lifelike_look.measure import measure_cast
from benchmarks.real.cases import CASES, Case
from benchmarks.real.filmed import FilmedClip
from benchmarks.real.frames import Retarget, test_frame, test_frames
from benchmarks.real.judge import Figures, Judge, TestFrame, changes, mean
from benchmarks.real.learning import measure_learning
from benchmarks.real.live_look_clip import PlayedFrame, draw_clip
from benchmarks.real.live_look_sheet import draw_sheet
from benchmarks.real.measure import (
    Networks,
    captured_clips,
    means,
    trained_model,
)
from benchmarks.real.parts import part_finder
from benchmarks.real.sent import PICTURES_A_SECOND, sent
from benchmarks.reporting.figures import FigureWriter
from renderer.evaluation.lpips import Lpips
from renderer.live_look.live_look import LiveLook
from renderer.live_look.picture import WebcamPicture
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene.arrays import Array, Float
from scene.live_appearance import LiveAppearance
from scene.sequence import crop_window
from services.joining.look_track import BITRATE
from services.live.look.receiver import PICTURE_PX

LIVE_CASES = tuple(case for case in CASES if case.other_clips or case.name == "desk")
_MARGIN = 0.1
TURNED = "patterned-shirt"
"""The case of which a clip is made, too."""
MUST, AIM = 0.10, 0.05
"""LPIPS at the webcam's own place, of body and face."""
MUST_BESIDE, AIM_BESIDE = 0.75, 0.5
"""LPIPS in the other cameras, as a share of that of the model alone."""


@dataclass(frozen=True, eq=False)
class ColouredFrame:
    """What live look makes of one judged frame."""

    frame: TestFrame
    """In the pose that it is shown in."""
    appearance: LiveAppearance


def run(
    writer: FigureWriter,
    footage: Path,
    networks: Networks,
    iterations: int,
    only: str = "",
    cases: tuple[Case, ...] = LIVE_CASES,
    assets: Path | None = None,
) -> None:
    """Measure what was not measured yet of `cases`, draw a sheet of each, and report.

    With MakeHuman's `assets`, also of lifelike performers (`benchmarks.lifelike_look`); and what
    models learn from pictures that were kept (`benchmarks.real.learning`).
    """
    cache = writer.cache(only)
    conditions = {
        "iterations": iterations,
        "lpips": networks.lpips.name,
        "picture_px": PICTURE_PX,
        "pictures_a_second": PICTURES_A_SECOND,
        "bitrate": BITRATE,
    }
    rows: dict[str, Any] = {}
    for case in cases:
        sheet = writer.picture(f"live-look-{case.name}.jpg")
        found = cache.measured(
            case.name,
            {"case": asdict(case), **conditions},
            lambda c=case, s=sheet: measure(c, footage, networks, iterations, s),
        )
        if found is not None:
            rows[case.name] = found
    lifelike: dict[str, Any] = {}
    if assets is not None:
        lifelike["lifelike"] = measure_cast(writer, cache, assets, networks, iterations)
    learning = measure_learning(cache, footage, networks, iterations)
    writer.write({**conditions, "cases": rows, **lifelike, "learning": learning})


def measure(
    case: Case, footage: Path, networks: Networks, iterations: int, sheet: Path
) -> dict[str, Any]:
    """The figures of one case; its contact sheet is written to `sheet`."""
    face_and_hand = part_finder(networks.face, networks.hand)
    with tempfile.TemporaryDirectory() as folder, face_and_hand as finder:
        judge = Judge(Lpips(networks.lpips), finder)
        clips = captured_clips(case, footage, networks, Path(folder))
        part, numbers = clips[case.trained].training_part(case.trained_share)
        model = trained_model(part, iterations).splats
        assert model is not None
        milliseconds: list[float] = []
        webcam: list[ColouredFrame] = []
        beside: list[ColouredFrame] = []
        played: list[PlayedFrame] = []
        for name in case.other_clips:
            webcam += _driven_by(clips[name], model, milliseconds, played)
        if case.other_cameras:
            frames = list(test_frames(case, clips, model, set(numbers), footage))
            beside = list(_beside(clips[case.trained], frames, max(numbers), model, milliseconds))
        draw_sheet(sheet, model, webcam or beside)
        if case.name == TURNED:
            draw_clip(sheet.with_name("turning.webp"), model, played, PICTURES_A_SECOND)
        return {
            "splats": len(model),
            "picture_ms": round(float(np.median(milliseconds)), 1),
            **({"webcam": _summary(judge, model, webcam)} if webcam else {}),
            **({"other_cameras": _summary(judge, model, beside)} if beside else {}),
        }


def _driven_by(
    clip: FilmedClip, model: SplatModel, milliseconds: list[float], played: list[PlayedFrame]
) -> Iterator[ColouredFrame]:
    """The judged frames of another clip, as it plays; all that play are added to `played`."""
    retarget, look = Retarget.between(clip, model), LiveLook(model)
    camera = retarget.camera(clip.camera)
    for index, picture in _played(clip, 0, retarget):
        begun = time.perf_counter()
        pose, appearance = look.see(picture)
        milliseconds.append(1e3 * (time.perf_counter() - begun))
        played.append(PlayedFrame(clip.footage.images[index], camera, pose, appearance))
        if index in clip.ruler.indices:
            frame = test_frame(clip, "webcam", index, camera, pose)
            yield ColouredFrame(frame, appearance)


def _beside(
    clip: FilmedClip,
    frames: list[TestFrame],
    last: int,
    model: SplatModel,
    milliseconds: list[float],
) -> Iterator[ColouredFrame]:
    """What other cameras filmed while the rest of the clip plays."""
    retarget, look = Retarget.between(clip, model), LiveLook(model)
    for index, picture in _played(clip, last + 1, retarget):
        begun = time.perf_counter()
        _, appearance = look.see(picture)
        milliseconds.append(1e3 * (time.perf_counter() - begun))
        for frame in frames:
            if frame.group == "other_cameras" and frame.index == index:
                yield ColouredFrame(frame, appearance)


def _played(
    clip: FilmedClip, first: int, retarget: Retarget
) -> Iterator[tuple[int, WebcamPicture]]:
    """Pictures that a webcam would send from frame `first` of the film on, and of every frame that
    is judged, as they arrive: each with the film's own number."""
    pairs = list(_sent_frames(clip, first))
    pictures = [webcam_picture(clip, number, retarget) for number, _ in pairs]
    yield from zip((index for _, index in pairs), sent(pictures), strict=True)


def _sent_frames(clip: FilmedClip, first: int) -> Iterator[tuple[int, int]]:
    """Numbers of the frames in the capture, and in the film."""
    next_s = -np.inf
    for number, time_s in enumerate(clip.sequence.motion.times_s):
        index = clip.index_of(float(time_s))
        if index < first or (time_s < next_s and index not in clip.ruler.indices):
            continue
        next_s = float(time_s) + (1.0 - 1e-3) / PICTURES_A_SECOND
        yield number, index


def webcam_picture(clip: FilmedClip, number: int, retarget: Retarget) -> WebcamPicture:
    """Frame `number` of a capture, cut to the person, before it is coded."""
    source = clip.sequence.train
    mask = source.mask(number)
    rows, columns = crop_window(mask, _MARGIN)
    width, height = columns.stop - columns.start, rows.stop - rows.start
    camera = source.camera(number).cropped(columns.start, rows.start, width, height)
    rgb, matte = (
        np.ascontiguousarray((255.0 * of[rows, columns] + 0.5).astype(np.uint8))
        for of in (source.image(number), mask)
    )
    picture = WebcamPicture(rgb, matte, retarget.camera(camera), retarget.pose(source.pose(number)))
    return picture.resized(min(1.0, PICTURE_PX / max(width, height)))


def _summary(judge: Judge, model: SplatModel, shown: list[ColouredFrame]) -> dict[str, Any]:
    """Means over the frames: of the model alone, and with live look."""
    renderer = SplatRenderer((model,))
    figures: dict[str, list[dict[str, Figures]]] = {"model": [], "live": []}
    pictures: dict[str, list[Array]] = {"model": [], "live": []}
    for one in shown:
        for name, appearance in (("model", None), ("live", one.appearance)):
            picture = rendered(renderer, model, one.frame, appearance)
            figures[name].append(judge.figures(picture, one.frame))
            pictures[name].append(picture[..., :3])
    return {
        name: means(figures[name]) | {"flicker": _flicker(shown, pictures[name])}
        for name in figures
    }


def rendered(
    renderer: SplatRenderer,
    model: SplatModel,
    frame: TestFrame,
    appearance: LiveAppearance | None,
) -> Float[Array, "H W 4"]:
    """The model at a frame's place, as it looks now."""
    pose = frame.pose
    transforms = model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    picture = renderer.render(
        frame.camera, [transforms], expressions=[pose.expression], appearances=[appearance]
    )
    return picture.copy()


def _flicker(shown: list[ColouredFrame], pictures: list[Array]) -> float | None:
    """As `benchmarks.real.judge.flicker`, over the pairs of successive frames."""
    ratios = [
        changes((pictures[a], pictures[b]), (shown[a].frame, shown[b].frame))
        for a, b in pairwise(range(len(shown)))
        if shown[b].frame.clip == shown[a].frame.clip
        and shown[b].frame.index == shown[a].frame.index + 1
    ]
    found = mean(ratios)
    return None if found is None else round(found, 3)
