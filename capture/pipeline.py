"""From a clip to a sequence folder: read, track, segment, fit, place, crop, judge, store.

Each stage is a function of its own package and can be called, tested and looked at alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from collections.abc import Sequence as Many
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from capture.body.model import BodyModel, load_body_model, require_height
from capture.captured import CapturedClip, crop_to_person, person_window, working_camera
from capture.detection.clip_expressions import clip_expressions
from capture.detection.face_and_hands import PartsAside
from capture.detection.landmarks import MediaPipeEstimator, PoseEstimator
from capture.detection.lifter import Lifter, closed_form, lift
from capture.detection.network_files import (
    NetworkSource,
    landmark_network_file,
    optional_network_file,
    require_given,
)
from capture.detection.tracking import Track, track_person
from capture.errors import BrokenSequence, NoPersonFound
from capture.fitting.face_shape import with_own_face
from capture.fitting.fit import STAGES, fit_clip
from capture.fitting.result import Fit
from capture.fitting.world import place_in_world
from capture.overlay import write_video
from capture.quality import CaptureQuality, judge
from capture.segmentation.clip import segment_clip
from capture.segmentation.exposure import evened, find_gains
from capture.sources.clips import MIN_FRAMES, read_clip
from capture.sources.video import MAX_FRAMES, MAX_SIDE_PX, Clip, Window, shrink
from capture.sources.webcam import record_webcam
from capture.storage import write_sequence
from scene.arrays import Array, Float, UInt8
from scene.errors import InvalidInput
from scene.sequence import PoseTrust

SIZE_PX = 1024
"""Longest side of the stored frames."""
_JUDGED_PX = 512
"""Longest side of the frames that the report measures and overlays show."""
_DRAFT_PX = 256
"""Longest side of a draft's frames: in the same seconds a training makes twice as many steps as at
512 px, and comes nearer to frames of that size."""
_DRAFT_STAGE = STAGES[1]
"""After it poses are about right, and nine tenths of the fit's time are still to come."""
MIN_FOUND = 0.25
"""Share of the sampled frames in which the person must be found."""

Progress = Callable[[float, str], None]
"""Called with the share done, 0 to 1, and a message."""


@dataclass(frozen=True, kw_only=True)
class CaptureOptions:
    """Options of a capture."""

    person: str
    """Name stored with the sequence."""
    pose_model: NetworkSource | Path | None = None
    """Where MediaPipe's pose landmarker is; not needed with an `estimator` of one's own."""
    face_model: NetworkSource | Path | None = None
    """Without it, or where it can't be fetched, the face stays at rest."""
    hand_model: NetworkSource | Path | None = None
    """Without it, or where it can't be fetched, fingers stay at rest."""
    estimator: PoseEstimator | None = None
    """Finds landmarks and masks in place of MediaPipe."""
    lifter: Lifter = closed_form
    """From an `estimator`'s landmarks to poses; by default closed-form kinematics of its 3D ones.
    MediaPipe's go through `capture.detection.lifter.lift`, which corrects their known errors."""
    body_model: BodyModel | None = None
    """Fitted in place of the default, which is anny's."""
    max_frames: int = MAX_FRAMES
    """Frames used, spread evenly over the clip."""
    size_px: int = SIZE_PX
    """Longest side of the stored frames; never enlarged."""
    focal_px: float | None = None
    """Focal length in the clip's own pixels; estimated where None."""
    height_m: float | None = None
    """The person's height, barefoot. Where None it is estimated, and with it how far away they
    stand: one camera can't tell."""
    overlay: Path | None = None
    """Where to write a video (.mp4) of the clip, whole pictures, with all that was found."""

    def require_usable(self) -> None:
        """Raises InvalidInput or PoseModelMissing, before any work, for unusable options."""
        path = self.overlay
        if path is not None and (path.suffix.lower() != ".mp4" or not path.parent.is_dir()):
            raise InvalidInput(
                f"overlay must be an .mp4 file in a folder that exists; got {path}; rename it"
            )
        require_given(self.pose_model, self.face_model, self.hand_model)
        if self.height_m is not None:
            require_height(self.height_m)
        if self.focal_px is not None and not 0.0 < self.focal_px < np.inf:
            raise InvalidInput(
                "focal_px must be positive, in pixels of the clip; "
                f"got {self.focal_px}; leave it out to have it estimated"
            )


@dataclass(frozen=True)
class _Reports:
    """Progress of each stage as a part of the whole, and whether to stop."""

    on_progress: Progress
    should_stop: Callable[[], bool]

    def part(self, start: float, end: float, message: str) -> Callable[[float], None]:
        self.on_progress(start, message)
        return lambda done: self.on_progress(start + (end - start) * done, message)


def capture_clip(
    path: Path,
    out: Path,
    options: CaptureOptions,
    *,
    on_progress: Progress = lambda *_: None,
    on_fit: Callable[[str, Fit], None] = lambda *_: None,
    on_draft: Callable[[Path], None] | None = None,
    should_stop: Callable[[], bool] = lambda: False,
) -> CaptureQuality:
    """Capture a video, a folder or zip of frames, or a zip of videos into the folder `out`.

    Args:
        on_progress: called with the share done and what is being done.
        on_fit: called with each stage of the fit and its result (`fit.STAGES`).
        on_draft: called once, early in the fit, with a sequence folder of smaller frames in the
            poses found so far, which is gone afterwards.
        should_stop: asked often; CaptureStopped follows.

    Returns the quality report, which is stored too. Raises UnreadableClip, NoPersonFound,
    PoseModelMissing, InvalidInput, CaptureStopped, BrokenSequence if `out` exists; nothing is left
    behind then.
    """
    if out.exists():
        raise BrokenSequence(f"out must not exist yet; got {out}; remove it or choose another")
    options.require_usable()
    reports = _Reports(on_progress, should_stop)
    read = reports.part(0.0, 0.08, "reading the clip")
    clip = read_clip(path, options.max_frames, read, should_stop, max_side=MAX_SIDE_PX)
    with _parts_aside(options) as aside:
        track, lifter = _track(clip, options, reports, aside)
        gains = find_gains(clip.images, track.people)
        clip = replace(clip, images=evened(clip.images, gains))
        cut_out = reports.part(0.28, 0.38, "cutting out the person")
        masks = segment_clip(clip.images, track.people, cut_out)
        parts = aside.found(len(clip.images))
    window = person_window(masks, clip.source_size)
    expressions = clip_expressions(parts, clip.times_s, track.takes)
    faces = [None if face is None else face.pixels for face in parts.faces]

    def captured(fit: Fit, images: Many[UInt8[Array, "H W 3"]]) -> CapturedClip:
        placed = place_in_world(fit, clip.times_s)
        placed = replace(placed, motion=replace(placed.motion, expressions=expressions))
        if options.body_model is None:
            height, width = clip.images[0].shape[:2]
            camera = working_camera(fit, placed, width, height)
            placed = replace(placed, body=with_own_face(placed.body, placed.motion, camera, faces))
        return crop_to_person(images, window, clip.source_size, track, masks, fit, placed)

    def on_stage(stage: str, fit: Fit) -> None:
        on_fit(stage, fit)
        if on_draft is not None and stage == _DRAFT_STAGE:
            out.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=".draft-", dir=out.parent) as folder:
                draft = Path(folder) / "draft"
                small = captured(fit, _worked_with(clip, window))
                _store(draft, path.name, clip, small, None, options, lambda _: None)
                on_draft(draft)

    fit = fit_clip(
        track.people,
        masks,
        clip.times_s,
        track.takes,
        load_body_model() if options.body_model is None else options.body_model,
        focal_px=_focal_px(clip, options),
        height_m=options.height_m,
        lifter=lifter,
        images=clip.images,
        parts=parts,
        on_progress=reports.part(0.38, 0.92, "fitting the body"),
        on_stage=on_stage,
        should_stop=should_stop,
    )
    finished = captured(fit, _filmed(path, clip, gains, window, options, reports))
    looked_at = finished.shrunk(_JUDGED_PX)
    quality = judge(looked_at, clip.recordings)
    on_written = reports.part(0.95, 1.0, "writing the sequence")
    _store(out, path.name, clip, finished, quality, options, on_written)
    if options.overlay is not None:
        write_video(looked_at.overlays(), options.overlay, clip.frames_per_second)
    return quality


def capture_webcam(
    index: int,
    out: Path,
    options: CaptureOptions,
    *,
    seconds: float = 15.0,
    on_progress: Progress = lambda *_: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> CaptureQuality:
    """Record with webcam `index` for `seconds`, then capture that clip; see `capture_clip`."""
    options.require_usable()  # else the recording would be lost
    with tempfile.TemporaryDirectory(prefix="metanerf-webcam-") as folder:
        clip = record_webcam(index, seconds, should_stop, folder=Path(folder))
        return capture_clip(clip, out, options, on_progress=on_progress, should_stop=should_stop)


def _parts_aside(options: CaptureOptions) -> PartsAside:
    """What looks at face and hands, as far as models are available."""
    models = (options.face_model, options.hand_model)
    face, hand = (None if model is None else optional_network_file(model) for model in models)
    return PartsAside(face, hand)


def _track(
    clip: Clip, options: CaptureOptions, reports: _Reports, aside: PartsAside
) -> tuple[Track, Lifter]:
    """The person in every frame, and what lifts such landmarks; `aside` looks at their parts.

    Raises NoPersonFound.
    """
    if options.estimator is not None:
        return _tracked(clip, options.estimator, reports, aside), options.lifter
    if options.pose_model is None:
        raise InvalidInput("capture must be given a pose_model or an estimator; got neither")
    with MediaPipeEstimator(landmark_network_file(options.pose_model)) as estimator:
        return _tracked(clip, estimator, reports, aside), lift


def _tracked(clip: Clip, estimator: PoseEstimator, reports: _Reports, aside: PartsAside) -> Track:
    track = track_person(
        clip.images,
        estimator,
        on_found=lambda frame, person: aside.look(frame, clip.images[frame], person),
        on_progress=reports.part(0.08, 0.28, "finding the person"),
        should_stop=reports.should_stop,
    )
    found = int(track.found.sum())
    needed = max(MIN_FRAMES, int(np.ceil(MIN_FOUND * len(clip.images))))
    if found < needed:
        raise NoPersonFound(
            f"the person must be seen in at least {needed} of {len(clip.images)} frames; got "
            f"{found}; keep one person inside the picture, well lit"
        )
    return track


def _focal_px(clip: Clip, options: CaptureOptions) -> float | None:
    """In pixels of the clip's pictures, which may have been made smaller."""
    if options.focal_px is None:
        return None
    return options.focal_px * max(clip.images[0].shape[:2]) / max(clip.source_size)


def _worked_with(clip: Clip, window: Window) -> list[UInt8[Array, "h w 3"]]:
    """The frames that the capture works with, cut to `window` of those that were filmed."""
    height, width = clip.images[0].shape[:2]
    across, down = width / clip.source_size[0], height / clip.source_size[1]
    rows, columns = (
        slice(round(share * span.start), round(share * span.stop))
        for share, span in zip((down, across), window, strict=True)
    )
    return [shrink(image[rows, columns], _DRAFT_PX) for image in clip.images]


def _filmed(
    path: Path,
    clip: Clip,
    gains: Float[Array, "F 3"],
    window: Window,
    options: CaptureOptions,
    reports: _Reports,
) -> Many[UInt8[Array, "H W 3"]]:
    """All frames cut to `window`, as sharp as they were filmed up to the size that is stored."""
    if max(clip.source_size) <= MAX_SIDE_PX:
        return [shrink(image[window], options.size_px) for image in clip.images]
    again = read_clip(
        path,
        options.max_frames,
        reports.part(0.92, 0.95, "reading the clip again, at its own size"),
        reports.should_stop,
        max_side=options.size_px,
        window=window,
    )
    return evened(again.images, gains)


def _store(
    out: Path,
    source: str,
    clip: Clip,
    captured: CapturedClip,
    quality: CaptureQuality | None,
    options: CaptureOptions,
    on_progress: Callable[[float], None],
) -> None:
    write_sequence(
        out,
        person=options.person,
        frames_per_second=clip.frames_per_second,
        body=captured.body,
        train=captured.frames(on_progress),
        confidence=captured.motion.confidence,
        source=source,
        pose_trust=PoseTrust.ESTIMATED,
        quality=None if quality is None else quality.as_json(),
    )
