"""Whom axes are measured with: studio performers with exact truth, and real people on film."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.real.ruler import Ruler
from benchmarks.stability.material import Material, Stage, Subject, frames_of, spread
from capture.storage import open_sequence
from capture.studio.lifelike.performer import make_lifelike_performer
from capture.studio.named_performers import LIFELIKE_PERFORMERS, seed_of_performer
from capture.studio.performer import FilmedPerformer, make_performer
from capture.studio.sequence import make_sequence
from scene.errors import InvalidInput
from scene.sequence import NOVEL_VIEW, FrameSource, Sequence

PAINTED, LIFELIKE, LOOSE = "painted", "lifelike", "loose clothes"
_PERFORMERS = {PAINTED: "amber", LIFELIKE: "hazel", LOOSE: "basil"}
FILMED = {"film, upper body": "orange_hoodie_book", "film, whole body": "juggler"}
_JUDGED, _PAIRS = 8, 6


@dataclass(frozen=True)
class SubjectSources:
    """What is at hand; who needs more is left out."""

    folder: Path
    """Where sequences are kept once they are made."""
    motion: Path | None = None
    """Folder of recorded motion; None: the studio's own turn."""
    assets: Path | None = None
    footage: Path | None = None
    networks: tuple[Path, Path, Path] | None = None
    """Of bodies, faces and hands."""
    size_px: int = 192
    frames: int = 60


def studio_subjects(inputs: SubjectSources, may_begin: Callable[[], bool]) -> Iterator[Subject]:
    """Performers whom the studio films, the one with most axes first.

    `may_begin`: whether there is time to film somebody; whoever was filmed before is there anyway.
    """
    yield _studio_subject(inputs, PAINTED)
    others = (LIFELIKE, LOOSE) if inputs.assets is not None else (LOOSE,)
    for name in others if inputs.motion is not None else ():
        if may_begin() or _folder(inputs, name).exists():
            yield _studio_subject(inputs, name)


def filmed_subjects(inputs: SubjectSources, may_begin: Callable[[], bool]) -> Iterator[Subject]:
    """Real people, captured; judged on their own clean frames, which stand in for a truth."""
    if inputs.footage is None or inputs.networks is None:
        return
    from capture.pipeline import CaptureOptions, capture_clip

    for name, clip in FILMED.items():
        try:
            path = Ruler.read(clip).require_footage(inputs.footage)
        except InvalidInput as error:
            print(f"{name} is left out: {error}", flush=True)
            continue
        folder = inputs.folder / f"captured-{clip}"
        if not folder.exists():
            if not may_begin():
                continue
            pose, face, hand = inputs.networks
            options = CaptureOptions(
                person=clip,
                pose_model=pose,
                face_model=face,
                hand_model=hand,
                max_frames=inputs.frames,
                size_px=inputs.size_px,
            )
            capture_clip(path, folder, options)
        captured = open_sequence(folder)
        yield Subject(name, material_of(captured, captured.train), filmed=True)


def material_of(clip: Sequence, judged: FrameSource) -> Material:
    """All training frames of `clip`, and some of `judged`."""
    places = spread(len(clip.train) - 1, _PAIRS)
    train = frames_of(clip.train, range(len(clip.train)))
    return Material(
        clip.body,
        clip.frames_per_second,
        train,
        frames_of(judged, spread(len(judged), _JUDGED)),
        tuple((train[place], train[place + 1]) for place in places),
        clip.motion,
    )


def _studio_subject(inputs: SubjectSources, name: str) -> Subject:
    performer, folder = _PERFORMERS[name], _folder(inputs, name)
    look = "loose" if name == LOOSE else "plain"
    assets = inputs.assets if name == LIFELIKE else None
    if not folder.exists():
        make_sequence(
            folder,
            performer=performer,
            assets=assets,
            motion=inputs.motion,
            look=look,
            frames=inputs.frames,
            size=inputs.size_px,
        )
    clip = open_sequence(folder)
    stage = None if look == "loose" else Stage(_made(performer, assets), look)
    return Subject(name, material_of(clip, clip.test[NOVEL_VIEW]), stage)


def _folder(inputs: SubjectSources, name: str) -> Path:
    return inputs.folder / f"{_PERFORMERS[name]}-{inputs.size_px}"


def _made(performer: str, assets: Path | None) -> FilmedPerformer:
    if assets is None:
        return make_performer(seed_of_performer(performer))
    return make_lifelike_performer(LIFELIKE_PERFORMERS[performer], assets)
