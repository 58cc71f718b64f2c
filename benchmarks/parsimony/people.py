"""On whom parts of the method are left out: each where what a part is for can be judged.

Real people at a webcam, in frames of their clip that training does not see and, aligned with the
picture, in another clip of theirs. What no frame shows of them nobody knows; that is judged on
lifelike performers, filmed from the front alone and seen from beside and behind.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.lifelike_look.performances import beside, hand_across_chest
from benchmarks.parsimony.rungs import Patches, patched
from benchmarks.parsimony.subjects import (
    Figures,
    Filmed,
    LadderSubject,
    OutsideData,
    Studio,
    captured_once,
    held_back,
    judged_parts,
)
from benchmarks.real.filmed import FilmedClip
from benchmarks.real.frames import Retarget, test_frame
from benchmarks.real.judge import Judge, TestFrame, crop_lpips
from benchmarks.real.parts import part_finder
from capture.segmentation.exposure import evened
from capture.sources.clips import read_clip
from capture.sources.video import Clip, evenly_spaced
from capture.storage import open_sequence, write_sequence
from capture.studio.lifelike.performer import make_lifelike_performer
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from renderer.evaluation.lpips import Lpips
from renderer.evaluation.metrics import psnr
from renderer.evaluation.pose_alignment import Aligner
from renderer.performer_model import PerformerModel
from scene.camera import orbit_camera
from scene.motion import Motion
from scene.sequence import Frame, PoseTrust, Sequence, body_crop
from scene.skeleton import Skeleton

_OTHER = {"body": ("psnr", "lpips"), "hands": ("psnr", "lpips")}
_OWN = {**_OTHER, "face": ("psnr", "lpips", "points_percent", "irises_percent")}
"""What is told of each part of another clip, and of their own."""
_ALIGNED = 4
"""Frames of another clip at most: each takes seconds."""
_GAMMA, _PERIODS = 2.2, 1.3
"""About that of sRGB; of a camera's drift over a clip."""
PLACES_DEG = {
    "front": (-15.0, 15.0),
    "beside": (-75.0, -45.0, 45.0, 75.0),
    "behind": (-135.0, 135.0, 180.0),
}
"""How far round the performer from their camera."""
_MOMENTS = 3
_TARGET, _DISTANCE_M, _FIELD_OF_VIEW_RAD = (0.0, 1.25, 0.0), 1.6, 0.6
_TURN_RAD = 0.26
"""To either side: what somebody turns who talks to their screen."""
_RATE_HZ, _SUPERSAMPLING = 15.0, 2


@dataclass(frozen=True)
class RealPerson:
    """Somebody at a webcam, in two clips that have rulers."""

    clip: str
    other: str
    """Captured by the whole method, whatever is left out of the clip's own capture."""
    drift_stops: float = 0.0
    """From darkest to brightest, by which the camera drifts in `clip`."""
    without: Patches = ()
    """Of the capture of `clip`."""

    def __call__(self, folder: Path, footage: OutsideData) -> Filmed:
        other = captured_once(self.other, folder.parent / self.other, footage)
        with patched((*drifting(self.drift_stops), *self.without)):
            filmed = captured_once(self.clip, folder, footage)
        clip, networks = filmed.without_ruler(), footage.networks

        def judged(model: PerformerModel) -> Figures:
            with part_finder(networks.face, networks.hand) as finder:
                judge, own = Judge(Lpips(networks.lpips), finder), held_back(filmed, model)[::2]
                figures = judged_parts(judge, model, own, _OWN)
                found = judged_parts(judge, model, _aligned(other, model, clip), _OTHER)
            return figures | {f"other_{name}": value for name, value in found.items()}

        return Filmed(clip, judged)


def drifting(stops: float) -> Patches:
    """The capture's reading of a clip, whose camera drifts by so much."""
    if stops == 0.0:
        return ()

    def read(*args: Any, **options: Any) -> Clip:
        clip = read_clip(*args, **options)
        phase = np.linspace(0.0, 2.0 * np.pi * _PERIODS, len(clip.images))
        gains = 2.0 ** (0.5 * stops / _GAMMA * np.sin(phase))
        return replace(clip, images=evened(clip.images, np.repeat(1.0 / gains[:, None], 3, axis=1)))

    return (("capture.pipeline.read_clip", read),)


def _aligned(other: FilmedClip, model: PerformerModel, clip: Sequence) -> list[TestFrame]:
    """Frames of the `other` clip's ruler that show hands, in the poses that fit their pictures
    best, of a `model` trained on `clip`."""
    retarget, aligner = Retarget.between(other, model), Aligner(model, clip)
    camera, frames = retarget.camera(other.camera), []
    shown = [index for index in other.ruler.indices if other.ruler.hands(index)]
    for index in (shown[place] for place in evenly_spaced(len(shown), _ALIGNED)):
        given = test_frame(other, "other", index, camera, retarget.pose(other.pose(index)))
        pose = aligner.align(Frame(given.truth, given.mask, camera, given.pose))
        frames.append(replace(given, pose=pose))
    return frames


@dataclass(frozen=True)
class FilmedFromFront:
    """A lifelike performer before one camera: they sway, and a hand goes across their chest.

    Their poses are the true ones, believed as estimated ones are.
    """

    performer: str
    size: int = 320
    frames: int = 60

    def __call__(self, folder: Path, footage: OutsideData) -> Filmed:
        row = LIFELIKE_PERFORMERS[self.performer]
        performer = make_lifelike_performer(row, footage.assets, expressive=True)
        motion = swaying(performer.body.skeleton, self.frames)
        size = (self.size, self.size)
        camera = orbit_camera(_TARGET, _DISTANCE_M, 0.0, 0.0, *size, _FIELD_OF_VIEW_RAD)
        lpips = Lpips(footage.networks.lpips)

        @cache
        def truth(number: int, degrees: float) -> Frame:
            pose = motion.pose(number)
            place = beside(camera, pose, performer.body.skeleton, degrees)
            seen = performer.render(pose, place, "plain", supersampling=_SUPERSAMPLING)
            return Frame(*seen, place, pose)

        if not folder.exists():
            write_sequence(
                folder,
                person=self.performer,
                frames_per_second=_RATE_HZ,
                body=performer.known_body,
                train=(truth(number, 0.0) for number in range(self.frames)),
                source="a hand across the chest, from the front",
                pose_trust=PoseTrust.ESTIMATED,
            )

        def judged(model: PerformerModel) -> Figures:
            found: dict[str, list[float]] = {}
            for place, angles in PLACES_DEG.items():
                for number in np.linspace(0, self.frames - 1, _MOMENTS + 2)[1:-1].astype(int):
                    pose = model.motion.pose_at(float(motion.times_s[number]))
                    for degrees in angles:
                        true = truth(int(number), degrees)
                        seen = beside(camera, pose, model.skeleton, degrees)
                        made = np.clip(model.render(seen, pose)[..., :3], 0.0, 1.0)
                        crop = body_crop(true.mask)
                        assert crop is not None
                        pair = made[crop], true.image[crop]
                        found.setdefault(f"{place}_psnr", []).append(psnr(*pair))
                        found.setdefault(f"{place}_lpips", []).append(crop_lpips(lpips, *pair))
            return {name: float(np.mean(values)) for name, values in found.items()}

        return Filmed(open_sequence(folder), judged)


def swaying(skeleton: Skeleton, frames: int) -> Motion:
    """A hand goes across the chest while the whole body turns to and fro; `frames` poses, 15 a
    second."""
    motion = hand_across_chest(skeleton).part(range(frames))
    phase = 2.0 * np.pi * np.arange(frames) / frames
    angles = motion.joint_angles.copy()
    angles[:, 0, 1] = _TURN_RAD * np.sin(phase)
    return replace(motion, joint_angles=angles)


PEOPLE = {
    one.name: one
    for one in (
        LadderSubject("hazel", "lifelike, a bob", FilmedFromFront("hazel")),
        LadderSubject("jasper", "lifelike, short hair, a jacket", FilmedFromFront("jasper")),
        LadderSubject(
            "grey-shirt",
            "real, hands before the chest",
            RealPerson("grey_shirt_sorry", "grey_shirt_please"),
            real=True,
        ),
        LadderSubject(
            "orange-hoodie",
            "real, long hair, fast hands",
            RealPerson("orange_hoodie_book", "orange_hoodie_walk"),
            real=True,
        ),
        LadderSubject(
            "patterned-shirt",
            "real, the camera's exposure drifts by a stop",
            RealPerson("patterned_shirt_sister", "patterned_shirt_eat", drift_stops=1.0),
            real=True,
        ),
        LadderSubject("amber", "painted, in loose clothes, dances", Studio("amber", look="loose")),
    )
}
