"""Splats on loose clothes, where a clip shows such."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from renderer.splats.cloth.fitting import FoundCut, descended, find_cut, looked_at
from renderer.splats.cloth.hanging import MotionPath, WornCloth
from renderer.splats.cloth.tubes import Tubes
from renderer.splats.layout import OPACITY
from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import FirstSplats, flat_splats
from renderer.splats.training.trained_splats import TrainedSplats
from scene.arrays import Array, Float
from scene.body import Body
from scene.motion import Motion
from scene.sequence import Sequence
from scene.skeleton import JOINT_COUNT, Skeleton

_FRAMES, _SIZE_PX = 24, 192
"""Frames that a cut is refined by, and about how many pixels a side of each."""
_REFINED_FROM = (0.15, 0.3, 0.5)
"""Shares of the training after which it is refined."""
_BLURS_PX, _ROUNDS = (2.0, 1.0), 3
"""From coarse to fine, and steps of Gauss-Newton at each."""


class ClipCloth(WornCloth):
    """A person's loose clothes in a clip, whose cut the training refines."""

    def __init__(
        self,
        tubes: Tubes,
        motion: Motion,
        skeleton: Skeleton,
        found: FoundCut | None = None,
    ) -> None:
        """Args: found: the cut of `tubes`; None: not known, and not refined."""
        super().__init__(tubes, motion, skeleton)
        self._found, self._refined = found, 0

    @classmethod
    def found(cls, sequence: Sequence) -> ClipCloth | None:
        """The person's, as found from outlines; None for tight ones."""
        found = find_cut(sequence)
        if found is None:
            return None
        return cls(found.tubes(), sequence.motion, sequence.body.skeleton, found)

    def due(self, fraction: float) -> bool:
        """Whether the cut is to be refined at `fraction` of the training."""
        left = _REFINED_FROM[self._refined :] if self._found is not None else ()
        return bool(left) and fraction >= left[0]

    def refine(
        self,
        difference: Callable[[int], Float[Array, "H W 4"]],
        splats: TrainedSplats,
        motion: Motion,
        skeleton: Skeleton,
    ) -> None:
        """Find the cut anew by what `splats` look like on it: `difference` between their picture in
        a frame, and the frame."""
        from scipy.ndimage import gaussian_filter

        assert self._found is not None
        found, before = self._found, splats.expressions
        chosen, part = looked_at(motion, _FRAMES)
        path = MotionPath.of(part, skeleton, motion.times_s[chosen])
        hung = np.zeros((len(motion), *self.tubes.rest.shape))
        splats.expressions = replace(before, hung=hung)

        def residual(numbers: Float[Array, "P"], blur_px: float) -> Float[Array, "R"]:
            hung[chosen] = path.hung(found.tubes(numbers))
            seen = []
            for frame in chosen.tolist():
                off = difference(frame)
                stride = max(1, max(off.shape) // _SIZE_PX)
                blurred = gaussian_filter(off, (blur_px, blur_px, 0.0))
                seen.append(blurred[::stride, ::stride].ravel())
            return np.concatenate(seen)

        numbers = found.numbers
        for blur_px in _BLURS_PX:
            numbers = descended(lambda one, px=blur_px: residual(one, px), numbers, _ROUNDS)
        splats.expressions = before
        self._found, self._refined = replace(found, numbers=numbers), self._refined + 1
        self.tubes = self._found.tubes()
        self.hang(motion, skeleton)

    def state(self) -> dict[str, Array]:
        """What `restore` needs."""
        if self._found is None:
            return {}
        return {"cut": self._found.numbers.copy(), "cut_refined": np.array(self._refined)}

    def restore(self, state: dict[str, Array], motion: Motion, skeleton: Skeleton) -> None:
        """Go back to `state`, in the poses of `motion`."""
        if self._found is not None:
            self._found = replace(self._found, numbers=state["cut"].copy())
            self._refined, self.tubes = int(state["cut_refined"]), self._found.tubes()
        self.hang(motion, skeleton)


def splats_on_cloth(
    cloth: Tubes, density: float, settings: SplatSettings, rng: np.random.Generator
) -> FirstSplats:
    """Grey ones spread over `cloth` at rest, `density` a square metre, each skinned by the joint
    that carries its tube."""
    corners = cloth.rest[cloth.quads]
    across = corners[:, 1] - corners[:, 0] + corners[:, 3] - corners[:, 2]
    down = corners[:, 2] - corners[:, 0] + corners[:, 3] - corners[:, 1]
    normals = 0.25 * np.cross(across, down)
    areas = np.linalg.norm(normals, axis=1)
    count = max(1, round(density * areas.sum()))
    # stratified along the quads' running area: more even than independent draws
    at = (np.arange(count) + rng.uniform(size=count)) / count * areas.sum()
    quad = np.minimum(np.searchsorted(np.cumsum(areas), at), len(areas) - 1)
    u, v = rng.uniform(size=(2, count, 1))
    upper, lower = corners[quad, 0], corners[quad, 2]
    points = (1.0 - v) * ((1.0 - u) * upper + u * corners[quad, 1]) + v * (
        (1.0 - u) * lower + u * corners[quad, 3]
    )
    weights = np.zeros((count, JOINT_COUNT))
    weights[np.arange(count), cloth.carriers[cloth.quads[quad, 0]]] = 1.0
    unit = normals[quad] / np.maximum(areas[quad, None], 1e-12)
    deviation = settings.scale_share / np.sqrt(density)
    first = flat_splats(points, unit, weights, deviation, settings.thickness)
    first.parameters[:, OPACITY] = settings.opacity_logit
    return replace(first, quads=quad.astype(np.int32))


def with_splats_on_cloth(
    first: FirstSplats,
    cloth: Tubes,
    body: Body,
    settings: SplatSettings,
    rng: np.random.Generator,
) -> FirstSplats:
    """`first`, those on `body`, and others as dense on `cloth`."""
    assert body.rest_vertices is not None
    assert body.faces is not None
    a, b, c = (body.rest_vertices[body.faces[:, corner]] for corner in range(3))
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    density = len(first.parameters) / area
    return first.joined(splats_on_cloth(cloth, density, settings, rng))
