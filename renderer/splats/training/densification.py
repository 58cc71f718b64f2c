"""Coarse splats first, and finer ones later where pictures still differ from them.

A step with a quarter of the splats takes less than half the time, so poses and colours settle
sooner. Splats whose pixels are right by then stay as they are: plain cloth needs no finer ones.
(Adaptive density control, Kerbl et al. 2023, splits by the pull on a splat; here by its error,
once, and onto the body's surface.)
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from renderer.splats.layout import COLOUR, LOG_SCALE, MEAN_X, MEAN_Y, OPACITY, POSITION
from renderer.splats.rasteriser.workspace import Workspace
from renderer.splats.settings import SplatSettings
from renderer.splats.training.even_places import even_places
from renderer.splats.training.evidence import shown_pixels
from renderer.splats.training.initialisation import FirstSplats
from scene.arrays import Array, Bool, Float, Int

_SHARE = 4
"""Fine splats for a coarse one."""
_ERROR = 0.01
"""Mean difference of a channel from which a splat is split."""
_SHOWN_PX = 0.05
"""Least evidence of a splat whose error is known; others are split, as coarse ones would stand out
beyond the outline."""
_NEAR_PX = 3
"""Side of the square about a splat whose pixels count as its own."""
_PLACE = slice(POSITION, POSITION + 3)


@dataclass(frozen=True, eq=False)
class Densification:
    """The coarse splats of a training, and the fine ones that may follow."""

    coarse: FirstSplats
    fine: FirstSplats
    parents: Int[Array, "M"] = field(init=False)
    """The coarse splat that each fine one may replace: the nearest at rest."""

    def __post_init__(self) -> None:
        from scipy.spatial import KDTree

        _, nearest = KDTree(self.coarse.parameters[:, _PLACE]).query(
            self.fine.parameters[:, _PLACE]
        )
        object.__setattr__(self, "parents", np.asarray(nearest))

    @classmethod
    def planned(
        cls, fine: FirstSplats, start: FirstSplats | None, settings: SplatSettings
    ) -> Densification | None:
        """From a quarter of `fine`, or from those of an earlier model; None where `fine` are few
        or the earlier model has half as many."""
        if len(fine.parameters) <= settings.densified_above:
            return None
        if start is None:
            return cls(_thinned(fine), fine)
        return cls(start, fine) if 2 * len(start.parameters) < len(fine.parameters) else None

    def splats(self, split: Bool[Array, "N"]) -> FirstSplats:
        """The coarse splats but for those to `split`, and the fine ones in their place."""
        finer = self.fine.taken(self._children(split))
        return self.coarse.taken(np.flatnonzero(~split)).joined(finer)

    def origins(self, split: Bool[Array, "N"]) -> Int[Array, "K"]:
        """The coarse splat that each of `splats` is, or is the child of."""
        return np.concatenate([np.flatnonzero(~split), self.parents[self._children(split)]])

    def _children(self, split: Bool[Array, "N"]) -> Int[Array, "K"]:
        """The fine splats that take the place of those to `split`."""
        return np.flatnonzero(split[self.parents])

    def parameters(
        self,
        split: Bool[Array, "N"],
        trained: Float[Array, "N P"],
        surface: Float[Array, "K P"],
    ) -> Float[Array, "K P"]:
        """Of `splats`, as training goes on: fine ones have their parents' colour and opacity and
        lie as far off the surface.

        Args:
            trained: parameters of the coarse splats.
            surface: first parameters of `splats`, on the same skeleton.
        """
        parameters, kept = surface.copy(), int((~split).sum())
        parameters[:kept] = trained[~split]
        children = self._children(split)
        parents = self.parents[children]
        normals = self.fine.normals[children]
        off = np.einsum("nx,nx->n", trained[parents, _PLACE] - surface[kept:, _PLACE], normals)
        parameters[kept:, _PLACE] += off[:, None] * normals
        parameters[kept:, COLOUR : COLOUR + 3] = trained[parents, COLOUR : COLOUR + 3]
        parameters[kept:, OPACITY] = trained[parents, OPACITY]
        return parameters


def to_split(errors: Iterable[tuple[Float[Array, "N"], Float[Array, "N"]]]) -> Bool[Array, "N"]:
    """Which splats pictures differ from, or do not show, by the `splat_errors` of some frames."""
    found = list(errors)
    shown = np.sum([weight for _, weight in found], axis=0)
    total = np.sum([error * weight for error, weight in found], axis=0)
    return (total > _ERROR * shown) | (shown < _SHOWN_PX * len(found))


def splat_errors(
    work: Workspace,
    contribution: Float[Array, "N"],
    picture: Float[Array, "H W 4"],
    truth: Float[Array, "H W 4"],
) -> tuple[Float[Array, "N"], Float[Array, "N"]]:
    """Mean difference of a channel between `picture` and `truth` (premultiplied) about each splat
    that `work` has projected, and how well the frame shows it, px."""
    from scipy.ndimage import uniform_filter

    height, width = picture.shape[:2]
    difference = np.abs(picture[..., :3] - truth[..., :3]).mean(axis=2)
    near = uniform_filter(difference, _NEAR_PX)
    column = np.clip(work.projected[:, MEAN_X].astype(np.int32), 0, width - 1)
    row = np.clip(work.projected[:, MEAN_Y].astype(np.int32), 0, height - 1)
    return near[row, column], shown_pixels(work, contribution)


def _thinned(first: FirstSplats) -> FirstSplats:
    """The most even quarter, as much larger."""
    places, sizes = first.parameters[:, _PLACE], np.exp(first.parameters[:, LOG_SCALE])
    count = len(first.parameters) // _SHARE
    thin = first.taken(even_places(places, first.normals, sizes, count))
    thin.parameters[:, LOG_SCALE : LOG_SCALE + 3] += 0.5 * np.log(_SHARE)
    return thin
