"""Chooses, of the pictures for live look, those that somebody's next model can learn from.

A picture is kept for the sides that it shows of head and trunk, where their model has not seen
them, if it is fit to be learnt from. Of each side the best few stay, so that their number has a
limit however long somebody talks.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from renderer.live_look.picture import WebcamPicture
from renderer.splats.layout import BOX_FILTER_PX2, POSITION
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.rasteriser.workspace import Workspace
from renderer.splats.training.surface_kinds import HEAD_KINDS, KINDS, surface_kinds
from scene.arrays import Array, Bool, Float, Int
from scene.camera import Camera
from scene.motion import Pose
from scene.skeleton import HEAD, JOINT_NAMES, Skeleton

SIDED_JOINTS = {"head": HEAD, "trunk": JOINT_NAMES.index("spine3")}
"""Parts that have sides, and the joints that turn them."""
SECTOR_DEG = 30
"""A side is so wide."""
LEVEL_DEG = 20.0
"""Elevation up to which a part is seen from level."""
A_SIDE = 6
"""Pictures of a side: what one has wrong, as a hand before it, the others show."""
MOST = 48
"""Pictures in all; there are as many sides, so that each can have its best."""
NEW_SHARE = 0.15
"""Share of a part's pixels, of splats that no frame has shown, from which its side is new."""
_LEAST_PX = 150
"""Pixels of a part from which its side is seen."""
_LEAST_SHARPNESS = 12.0
_LUMA = (0.08, 0.9)
_MOST_CLIPPED = 0.25
_MOST_SOFT = 0.25
_LEAST_OVERLAP = 0.8
_MOST_DIFFERENCE = 0.12
_EXPOSURE = (0.7, 1.4)
"""What evens out a picture's exposure; beyond it, the light is another."""
_INSIDE, _OUTSIDE = 230, 25
"""Matte of what is surely the person, and surely not."""


@dataclass(frozen=True, order=True)
class Side:
    """From where a part of the body is seen."""

    part: str
    azimuth_deg: int
    """Middle of the sector: 0 before the part, 90 at its left; -180 to 150."""
    elevation: int
    """Of a head: 1 from above, 0 from level, -1 from below; of a trunk 0."""


@dataclass(frozen=True)
class Fitness:
    """How well a picture can be learnt from."""

    sharpness: float
    """Variance of the Laplacian inside the person, squared levels of 8 bits."""
    luma: float
    """Mean of the person, [0, 1]."""
    clipped: float
    """Share of the person that is black or white."""
    soft: float
    """Pixels that the matte calls neither in nor out, as a share of the person's."""
    overlap: float
    """Intersection over union of the matte and the model in the aligned pose."""
    difference: float
    """Mean over what the model has seen, sRGB, at the model's exposure."""

    @property
    def sufficient(self) -> bool:
        """Whether it may be learnt from."""
        return (
            self.sharpness >= _LEAST_SHARPNESS
            and _LUMA[0] <= self.luma <= _LUMA[1]
            and self.clipped <= _MOST_CLIPPED
            and self.soft <= _MOST_SOFT
            and self.overlap >= _LEAST_OVERLAP
            and self.difference <= _MOST_DIFFERENCE
        )

    @property
    def score(self) -> float:
        """The greater, the better: what decides between pictures of a side."""
        sharp = self.sharpness / (self.sharpness + _LEAST_SHARPNESS)
        return sharp * self.overlap * (1.0 - self.difference)


@dataclass(frozen=True, eq=False)
class KeptFrame:
    """A picture that may be kept."""

    picture: WebcamPicture
    """At the model's exposure, its pose aligned with it."""
    sides: tuple[Side, ...]
    """That are new to the model."""
    fitness: Fitness


class BestOfSides:
    """The best frames of each side, `MOST` at most; the best of a side always stays."""

    def __init__(self) -> None:
        self._frames: list[KeptFrame] = []

    def offer(self, frame: KeptFrame) -> None:
        """Keep `frame` if it is among the best of one of its sides."""
        if not frame.fitness.sufficient or not frame.sides:
            return
        ahead: dict[Side, int] = {}
        """Frames of each side that are better."""
        ranked: list[tuple[int, KeptFrame]] = []
        for one in sorted([*self._frames, frame], key=_best_first):
            rank = min(ahead.get(side, 0) for side in one.sides)
            ahead |= {side: ahead.get(side, 0) + 1 for side in one.sides}
            if rank < A_SIDE:
                ranked.append((rank, one))
        ranked.sort(key=lambda pair: pair[0])
        self._frames = [one for _, one in ranked[:MOST]]

    @property
    def frames(self) -> list[KeptFrame]:
        """In the order of their moments."""
        return sorted(self._frames, key=lambda one: one.picture.pose.time_s)


class FrameKeeper:
    """Looks at one performer's pictures; belongs to one thread."""

    def __init__(self, model: SplatModel) -> None:
        self.model, self.best = model, BestOfSides()
        self._renderer, self._work = SplatRenderer((model.filmed_parts(),)), Workspace(len(model))
        self._joints = model.joints.astype(np.uint16)
        rest = model.parameters[:, POSITION : POSITION + 3]
        kinds = surface_kinds(rest, model.joints, model.weights, model.skeleton)
        self._parts = {
            "head": np.isin(kinds, HEAD_KINDS),
            "trunk": kinds == KINDS.index("trunk"),
        }

    def look_at(self, picture: WebcamPicture) -> KeptFrame | None:
        """What `picture`, whose pose is aligned with it, is good for; None where it shows nothing
        that the model has seen."""
        drawn, front = self._drawn(picture)
        known = picture.known() > 0.0
        seen = known & (front >= 0) & self.model.seen[front] & (drawn[..., 3] > 0.9)
        if np.count_nonzero(seen) < _LEAST_PX:
            return None
        rgb = picture.rgb.astype(np.float32) / np.float32(255.0)
        gain = _gain(rgb[seen], drawn[seen][:, :3])
        evened = np.clip(rgb * gain, 0.0, 1.0)
        difference = float(np.abs(evened[seen] - drawn[seen][:, :3]).mean())
        pose, camera = picture.pose, picture.camera
        return KeptFrame(
            replace(picture, rgb=(255.0 * evened + 0.5).astype(np.uint8)),
            tuple(
                side_of(part, self.model.skeleton, pose, camera)
                for part, of_part in self._parts.items()
                if self._is_new(known & (front >= 0) & of_part[front], front)
            ),
            _fitness(picture, drawn[..., 3], difference),
        )

    def _drawn(self, picture: WebcamPicture) -> tuple[Float[Array, "H W 4"], Int[Array, "H W"]]:
        """The model where the picture has it, and which splat each pixel shows."""
        pose, camera, skeleton = picture.pose, picture.camera, self.model.skeleton
        moved = skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
        moved, shown = moved.astype(np.float32), [pose.expression]
        drawn = self._renderer.render(camera, [moved], expressions=shown)
        shaded = self._renderer.shaded(camera, moved, expressions=shown)
        weights = self.model.weights
        return drawn, self._work.front(shaded, self._joints, weights, moved, camera, BOX_FILTER_PX2)

    def _is_new(self, of_part: Bool[Array, "H W"], front: Int[Array, "H W"]) -> bool:
        pixels = np.count_nonzero(of_part)
        unseen = np.count_nonzero(of_part & ~self.model.seen[front])
        return bool(pixels >= _LEAST_PX and unseen >= NEW_SHARE * pixels)


def side_of(part: str, skeleton: Skeleton, pose: Pose, camera: Camera) -> Side:
    """The side of `part` that `camera` sees."""
    joint = SIDED_JOINTS[part]
    turns = skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)[joint]
    place = turns[:3, :3] @ skeleton.rest_joints[joint] + turns[:3, 3]
    x, y, z = turns[:3, :3].T @ (camera.position - place)
    sector = round(np.degrees(np.arctan2(x, z)) / SECTOR_DEG) * SECTOR_DEG
    elevation_deg = np.degrees(np.arctan2(y, np.hypot(x, z)))
    level = part != "head" or abs(elevation_deg) <= LEVEL_DEG
    return Side(part, (sector + 180) % 360 - 180, 0 if level else int(np.sign(elevation_deg)))


def _best_first(frame: KeptFrame) -> tuple[float, float]:
    return -frame.fitness.score, frame.picture.pose.time_s


def sides_shown(frames: Iterable[KeptFrame]) -> list[Side]:
    """Of all `frames`, each once."""
    return sorted({side for frame in frames for side in frame.sides})


def _gain(rgb: Float[Array, "M 3"], wanted: Float[Array, "M 3"]) -> Float[Array, "3"]:
    """Factor a channel that gives `rgb` the exposure of what is `wanted`."""
    ratio = wanted.mean(axis=0) / np.maximum(rgb.mean(axis=0), 0.02)
    return np.clip(ratio, *_EXPOSURE).astype(np.float32)


def _fitness(picture: WebcamPicture, alpha: Float[Array, "H W"], difference: float) -> Fitness:
    import cv2

    person = picture.matte > _INSIDE
    luma = cv2.cvtColor(picture.rgb, cv2.COLOR_RGB2GRAY)
    # the person's own edge must not count as sharp
    within = cv2.erode(person.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    laplacian = cv2.Laplacian(luma, cv2.CV_32F)
    inside = luma[within]
    area = max(int(np.count_nonzero(person)), 1)
    half, covered = picture.matte > 127, alpha > 0.5
    return Fitness(
        sharpness=float(laplacian[within].var()) if inside.size else 0.0,
        luma=float(inside.mean() / 255.0) if inside.size else 0.0,
        clipped=_share((inside <= 2) | (inside >= 253)),
        soft=float(np.count_nonzero((picture.matte > _OUTSIDE) & ~person) / area),
        overlap=float((half & covered).sum() / max((half | covered).sum(), 1)),
        difference=difference,
    )


def _share(of: Bool[Array, "M"]) -> float:
    return float(of.mean()) if of.size else 0.0
