"""How far a model in training is from some frames: body, face and hands apart.

A picture counts as worse by its squared error, and by LPIPS: fewer splats lose sharpness first,
which squared errors hardly notice, and neither does SSIM. Frames that training sees are learnt by
heart by few splats, too; so pictures from beside, of which there is no truth, may not come far from
those of another number of splats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from renderer.splats.training.surface_kinds import KINDS
from renderer.splats.training.trainer import SplatTrainer
from scene.arrays import Array, Bool, Float

REGIONS = ("body", "face", "hands")
_LOOKED_AT = ("body", "face")
"""Regions that are large enough for LPIPS."""
_LEAST_PX = 100
"""Pixels of a region, all frames together, from which it is judged."""
_SHOWN = 0.5
"""Alpha of what belongs to the person."""
_LEAST_SIDE_PX = 32
"""Side of a crop of which LPIPS tells something."""
_WORSE_DB = {"body": 0.5, "face": 0.15, "hands": 0.6}
"""How much worse splats may be that have just been merged: half of it is left in the end."""
_UNSEEN_ERROR = 1e-4
"""Squared error that nobody sees: between two and three levels of 8 bits."""
_WORSE_LPIPS, _UNSEEN_LPIPS = 1.02, 0.001
"""How many times as large it may be then, and what is too little to be seen."""
_BESIDE_RAD, _EVERY, _APART_LPIPS = 0.26, 2, 0.011
"""How far beside its camera every second frame is looked at, to either side in turn, and how far
apart two models may look there: frames that training does not see lose up to 1 % of their LPIPS
by then, and 3 % at 0.012 to 0.019."""


@dataclass(frozen=True)
class Errors:
    """Means over frames, of the regions that they show."""

    squared: dict[str, float]
    lpips: dict[str, float]
    apart: float = 0.0
    """LPIPS to other pictures from beside."""

    def lost(self, of_all: Errors) -> dict[str, Any]:
        """How much worse these are than `of_all`, for the record."""
        return {
            "lost_db": {
                name: round(10.0 * float(np.log10(error / max(of_all.squared[name], 1e-12))), 3)
                for name, error in self.squared.items()
            },
            "lpips": {
                name: [round(of_all.lpips[name], 4), round(value, 4)]
                for name, value in self.lpips.items()
            },
        }

    def as_good_as(self, of_all: Errors) -> bool:
        """Whether nobody would see a difference once training has gone on."""
        return (
            self.apart <= _APART_LPIPS
            and all(
                error + _UNSEEN_ERROR
                <= 10.0 ** (0.1 * _WORSE_DB[name]) * (of_all.squared[name] + _UNSEEN_ERROR)
                for name, error in self.squared.items()
            )
            and all(
                value <= _WORSE_LPIPS * of_all.lpips[name] + _UNSEEN_LPIPS
                for name, value in self.lpips.items()
            )
        )


class WatchedFrames:
    """Frames of a training, with the pixels that show each region as the model is now."""

    def __init__(self, trainer: SplatTrainer, frames: tuple[int, ...]) -> None:
        self._trainer, self._frames = trainer, frames
        self._pixels = [self._regions(frame) for frame in frames]

    def light(self) -> Float[Array, "N"]:
        """Light that each splat blends into a frame on the mean, px."""
        total = np.zeros(len(self._trainer.splats))
        for frame in self._frames:
            total += self._trainer.drawing.contribution(frame)
        return total / len(self._frames)

    def from_beside(self) -> list[Float[Array, "_ _ 4"]]:
        """Pictures of the model as it is now."""
        return [
            self._trainer.drawing.turned(frame, (-1.0) ** place * _BESIDE_RAD)
            for place, frame in enumerate(self._frames[::_EVERY])
        ]

    def errors(self, from_beside: Sequence[Float[Array, "_ _ 4"]] = ()) -> Errors:
        """Of the model as it is now, which is held to pictures `from_beside`, if there are any."""
        squared, pixels = np.zeros(len(REGIONS)), np.zeros(len(REGIONS))
        lpips: dict[str, list[float]] = {name: [] for name in _LOOKED_AT}
        for frame, regions in zip(self._frames, self._pixels, strict=True):
            pictures = self._trainer.drawing.pictures(frame)
            made, truth = (np.clip(one[..., :3], 0.0, 1.0) for one in pictures)
            squared += (regions * np.square(made - truth).mean(axis=2)).sum(axis=(1, 2))
            pixels += regions.sum(axis=(1, 2))
            for name in _LOOKED_AT:
                if (crop := _crop(regions[REGIONS.index(name)])) is not None:
                    lpips[name].append(self._lpips(made[crop], truth[crop]))
        shown = [(name, e / p) for name, e, p in zip(REGIONS, squared, pixels, strict=True)
                 if p >= _LEAST_PX]  # fmt: skip
        return Errors(
            {name: float(error) for name, error in shown},
            {name: float(np.mean(values)) for name, values in lpips.items() if values},
            self._apart(from_beside),
        )

    def _apart(self, others: Sequence[Float[Array, "_ _ 4"]]) -> float:
        """LPIPS between pictures from beside and `others`; 0 without any."""
        if not others:
            return 0.0
        apart = [
            self._lpips(made[crop][..., :3], other[crop][..., :3])
            for made, other in zip(self.from_beside(), others, strict=True)
            if (crop := _crop(other[..., 3] > _SHOWN)) is not None
        ]
        return float(np.mean(apart)) if apart else 0.0

    def _regions(self, frame: int) -> Bool[Array, "R H W"]:
        front, kinds = self._trainer.drawing.front(frame), self._trainer.splats.kinds
        kind = np.where(front >= 0, kinds[front], -1)
        parts = [kind == KINDS.index(name) for name in REGIONS[1:]]
        return np.stack([np.ones_like(parts[0]), *parts])

    def _lpips(self, made: Float[Array, "H W 3"], truth: Float[Array, "H W 3"]) -> float:
        import torch

        pair = (torch.from_numpy(np.ascontiguousarray(one)).movedim(-1, 0) for one in (made, truth))
        with torch.no_grad():
            return float(self._distance(*(one[None] for one in pair))[0])

    @cached_property
    def _distance(self):
        from renderer.evaluation.lpips import PACKAGED_BACKBONE, Lpips

        return Lpips(PACKAGED_BACKBONE)


def _crop(region: Bool[Array, "H W"]) -> tuple[slice, slice] | None:
    """Rows and columns of a region that is large enough to be looked at."""
    sides = [np.flatnonzero(region.any(axis=axis)) for axis in (1, 0)]
    if any(side.size == 0 or np.ptp(side) < _LEAST_SIDE_PX for side in sides):
        return None
    rows, columns = (slice(int(side[0]), int(side[-1]) + 1) for side in sides)
    return rows, columns
