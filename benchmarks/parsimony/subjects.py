"""Who is modelled, from simple to rich, and on what pictures their models are judged.

Studio performers: unseen views of exact poses. Real people: the frames of the ruler
(`benchmarks.real`), which training does not see, in the poses that training gives the frames beside
them; capture does see them.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.real.filmed import FilmedClip, film
from benchmarks.real.frames import test_frame
from benchmarks.real.judge import Judge, TestFrame, mean
from benchmarks.real.measure import Networks
from benchmarks.real.parts import part_finder
from benchmarks.real.ruler import Ruler
from capture.pipeline import CaptureOptions
from capture.storage import open_sequence
from capture.studio import make_sequence
from renderer.evaluation.evaluate import evaluate
from renderer.evaluation.lpips import Lpips
from renderer.performer_model import PerformerModel
from scene.sequence import NOVEL_VIEW, Sequence

Figures = dict[str, float | None]


@dataclass(frozen=True)
class OutsideData:
    """Where what does not ship with the package lies."""

    motion: Path
    assets: Path
    real: Path
    networks: Networks


@dataclass(frozen=True)
class LadderSubject:
    """A person in one clip."""

    name: str
    words: str
    film: Callable[[Path, OutsideData], Filmed]
    """Into a folder, or from it where that has been done."""
    real: bool = False
    as_field: bool = False
    """A neural field of them is trained, too."""


@dataclass(frozen=True, eq=False)
class Filmed:
    """What is trained on, and how a model of it is judged."""

    clip: Sequence
    judged: Callable[[PerformerModel], Figures]
    """`body_psnr` and `face_psnr`, dB, and the LPIPS of both."""


@dataclass(frozen=True)
class Studio:
    """A performer of the studio, 60 frames of `size` px in flat light, in a `look` of it."""

    performer: str | None = None
    lifelike: bool = False
    size: int = 256
    frames: int = 60
    look: str = "plain"

    def __call__(self, folder: Path, footage: OutsideData) -> Filmed:
        if not folder.exists():
            make_sequence(
                folder,
                performer=self.performer,
                assets=footage.assets if self.lifelike else None,
                motion=footage.motion if self.performer else None,
                look=self.look,
                frames=self.frames,
                size=self.size,
                uniform=self.performer is None,
            )
        clip = open_sequence(folder)

        def judged(model: PerformerModel) -> Figures:
            found = evaluate(model, clip, footage.networks.lpips)
            return {f"body_{name}": found[name][NOVEL_VIEW]["body_crop"] for name in _MEASURES}

        return Filmed(clip, judged)


_MEASURES = ("psnr", "lpips")
_PARTS = {"body": _MEASURES, "face": _MEASURES}


@dataclass(frozen=True)
class WebcamClip:
    """A real person in the clip of a ruler."""

    clip: str

    def __call__(self, folder: Path, footage: OutsideData) -> Filmed:
        filmed, networks = captured_once(self.clip, folder, footage), footage.networks

        def judged(model: PerformerModel) -> Figures:
            with part_finder(networks.face, networks.hand) as finder:
                judge = Judge(Lpips(networks.lpips), finder)
                return judged_parts(judge, model, held_back(filmed, model), _PARTS)

        return Filmed(filmed.without_ruler(), judged)


def captured_once(clip: str, folder: Path, footage: OutsideData) -> FilmedClip:
    """The `clip` of a ruler, captured into `folder` unless it has been."""
    ruler, about, networks = Ruler.read(clip), folder.with_suffix(".json"), footage.networks
    focal_px = json.loads(about.read_text())["focal_px"] if about.exists() else None
    if focal_px is None:
        shutil.rmtree(folder, ignore_errors=True)  # of a run that was cut before it said so
    options = CaptureOptions(
        person=clip,
        pose_model=networks.pose,
        face_model=networks.face,
        hand_model=networks.hand,
    )
    filmed = film(ruler, footage.real, folder, options, focal_px)
    about.write_text(json.dumps({"focal_px": filmed.focal_px}))
    return filmed


def held_back(filmed: FilmedClip, model: PerformerModel) -> list[TestFrame]:
    """The ruler's frames of the clip that `model` learnt the rest of."""
    frames = []
    for index in filmed.ruler.indices:
        pose = model.motion.pose_at(float(filmed.footage.times_s[index]))
        frames.append(test_frame(filmed, "unseen", index, filmed.camera, pose))
    return frames


def judged_parts(
    judge: Judge,
    model: PerformerModel,
    frames: Iterable[TestFrame],
    measures: Mapping[str, Iterable[str]],
) -> Figures:
    """The `measures` of each part, see `Judge`: means over `frames`; None where none shows it."""
    rows = [judge.figures(model.render(frame.camera, frame.pose), frame) for frame in frames]
    return {
        f"{part}_{name}": mean(row[part].get(name) for row in rows)
        for part, names in measures.items()
        for name in names
    }


SUBJECTS = (
    LadderSubject(
        "uniform", "painted, clothes of one colour each, turns in place", Studio(), as_field=True
    ),
    LadderSubject("amber", "painted, stripes and letters, dances", Studio("amber"), as_field=True),
    LadderSubject("flint", "lifelike, walks", Studio("flint", lifelike=True), as_field=True),
    LadderSubject(
        "amber-loose", "painted, in loose clothes, dances", Studio("amber", look="loose")
    ),
    LadderSubject(
        "grey-shirt",
        "real, at a webcam",
        WebcamClip("grey_shirt_sorry"),
        real=True,
        as_field=True,
    ),
    LadderSubject(
        "patterned-shirt",
        "real, at a webcam",
        WebcamClip("patterned_shirt_sister"),
        real=True,
        as_field=True,
    ),
)
QUICK = (LadderSubject("uniform", "as above, small", Studio(size=96, frames=24)),)


def about(subject: LadderSubject) -> dict[str, Any]:
    """For the record."""
    return {"name": subject.name, "words": subject.words, "clip": repr(subject.film)}
