"""Finds a person's loose clothes from the outlines of a clip: whether there are any, their cut, and
how they swing.

What the masks show beyond the body is explained by cloth that is simulated over the clip's motion
and projected; Gauss-Newton with differences in place of derivatives fits the few numbers of a
`Cut`. Outlines are blurred, so that what is off by some pixels still pulls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from renderer.splats.cloth.hanging import MotionPath
from renderer.splats.cloth.tubes import SKIRT, SLEEVES, Cut, Tubes, cut_tubes
from scene.arrays import Array, Bool, Float, Int
from scene.body import Body
from scene.motion import Motion
from scene.sequence import Sequence

_FRAMES, _SIZE_PX = 60, 128
"""Frames looked at, at most, and the longest side of their outlines."""
_FEW = 12
"""Frames that tell whether clothes may be loose, and by which cut about."""
_SPAN_S = 12.0
"""Of the clip that is looked at: simulating it takes 50 ms."""
_LEAST_FRAMES = 8
_BEYOND_PX = 2
"""How far beyond the body's own outline cloth must reach to count."""
_LOOSE = 0.05
"""Share of the masks beyond the body from which clothes may be loose: of tight ones on exact poses
it is nil."""
_EXPLAINED = 0.4
"""Least share of the squared difference between masks and body that cloth must explain, and
(`_NEEDED`) that each garment must explain alone."""
_NEEDED = 0.08
_DRAWS, _PROMISING = 30, 0.2
"""Random cuts that are tried first, and what the best of them must explain. Of loose clothes it
explains over nine tenths; of hair or of a body that is fitted badly, at most a sixth, and to find
that none is better would take longer than a first model."""
_BLURS_PX = (3.0, 1.5)
"""From coarse to fine."""
_ROUNDS, _LEAST_GAIN = 10, 0.004
"""Steps of Gauss-Newton at each blur, at most; each must gain so much."""
_LOGS = slice(6, 9)
"""Numbers of a `Cut` that are varied by their logarithm: how it swings."""
_STEPS = np.array([0.02, 0.03, 0.03, 0.05, 0.05, 0.01, 0.1, 0.2, 0.3])
"""Differences by which each number is varied."""
_LOW = np.array([-0.05, 0.05, 0.0, -0.3, 0.3, 0.0, *np.log([0.1, 0.2, 0.005])])
_HIGH = np.array([0.25, 1.0, 0.8, 0.6, 1.1, 0.25, *np.log([4.0, 10.0, 0.45])])
_LIKELY_LOW = np.array([0.0, 0.2, 0.0, -0.2, 0.6, 0.0, *np.log([0.4, 0.5, 0.03])])
_LIKELY_HIGH = np.array([0.15, 0.7, 0.5, 0.3, 1.0, 0.15, *np.log([2.0, 4.0, 0.3])])
"""Where random cuts are drawn."""
_ATTEMPTS = 4
"""Dampings that are tried before a step is given up."""
_FARTHEST = 3.0
"""Differences that a step may take a number by."""


@dataclass(frozen=True, eq=False)
class Outlines:
    """Masks of some frames, the body's own outlines, and the motion between."""

    masks: Float[Array, "F H W"]
    body: Bool[Array, "F H W"]
    projections: Float[Array, "F 3 4"]
    """World -> homogeneous pixels."""
    path: MotionPath
    """The frames are its moments."""

    @classmethod
    def of(cls, sequence: Sequence, count: int = _FRAMES) -> Outlines:
        """Of at most `count` frames of `sequence`, whose body has a surface: as many rows and
        columns as all of them have."""
        from renderer.splats.cloth.simulation_kernels import cover

        body, frames = sequence.body, sequence.train
        assert body.faces is not None
        chosen, motion = looked_at(sequence.motion, count)
        masks, covers, projections = [], [], []
        for frame in chosen.tolist():
            camera, mask = frames.camera(frame), frames.mask(frame)
            scale = min(1.0, _SIZE_PX / max(mask.shape))
            small = camera.resized(round(camera.width * scale), round(camera.height * scale))
            masks.append(shrunk(mask, (small.height, small.width)))
            projections.append(small.intrinsics @ small.world_to_camera)
            covered = np.zeros(masks[-1].shape, np.uint8)
            posed = body.posed_vertices(frames.pose(frame))
            cover(_projected(projections[-1], posed), body.faces.astype(np.int32), covered)
            covers.append(covered > 0)
        rows, columns = np.min([mask.shape for mask in masks], axis=0)
        return cls(
            np.stack([mask[:rows, :columns] for mask in masks]),
            np.stack([covered[:rows, :columns] for covered in covers]),
            np.stack(projections),
            MotionPath.of(motion, body.skeleton, sequence.motion.times_s[chosen]),
        )

    @property
    def beyond(self) -> float:
        """Share of the masks that lies clearly beyond the body."""
        from scipy.ndimage import binary_dilation

        square = np.ones((1, 2 * _BEYOND_PX + 1, 2 * _BEYOND_PX + 1), bool)
        near = np.asarray(binary_dilation(self.body, square), bool)
        return float(self.masks[~near].sum() / max(self.masks.sum(), 1.0))

    def differences(self, tubes: Tubes | None) -> Float[Array, "F H W"]:
        """Cloth where there is no mask (1), and the other way round (-1); 0 where the body is, for
        what masks lack of it says nothing about cloth."""
        from renderer.splats.cloth.simulation_kernels import cover

        covered = np.zeros(self.body.shape, np.uint8)
        if tubes is not None:
            cloth, triangles = self.path.vertices(tubes), tubes.triangles
            for picture, projection, vertices in zip(covered, self.projections, cloth, strict=True):
                cover(_projected(projection, vertices), triangles, picture)
        return (covered - self.masks) * ~self.body


def _projected(projection: Float[Array, "3 4"], points: Float[Array, "V 3"]) -> Array:
    seen = points @ projection[:, :3].T + projection[:, 3]
    return seen[:, :2] / np.maximum(seen[:, 2:], 1e-6)


def shrunk(mask: Float[Array, "H W"], size: tuple[int, int]) -> Float[Array, "h w"]:
    """`mask`, each pixel the mean of those that it lies over."""
    for axis, count in enumerate(size):
        pixels = mask.shape[axis]
        first = np.arange(count) * pixels // count
        last = -(-np.arange(1, count + 1) * pixels // count)
        sums = np.cumsum(np.insert(mask, 0, 0.0, axis), axis, dtype=np.float64)
        shares = np.expand_dims(1.0 / (last - first), 1 - axis)
        mask = (np.take(sums, last, axis) - np.take(sums, first, axis)) * shares
    return mask.astype(np.float32)


def looked_at(motion: Motion, count: int) -> tuple[Int[Array, "F"], Motion]:
    """At most `count` frames of `motion`, evenly over as much of it as is looked at, and that."""
    within = np.flatnonzero(motion.times_s - motion.times_s[0] <= _SPAN_S)
    places = np.linspace(0, len(within) - 1, min(count, len(within))).round().astype(int)
    return within[np.unique(places)], motion.part(within.tolist())


@dataclass(frozen=True, eq=False)
class FoundCut:
    """Garments and their cut, by numbers that vary on similar scales."""

    body: Body
    numbers: Float[Array, "P"]
    """Those of a `Cut`; how it swings by logarithms."""
    garments: tuple[str, ...]

    @classmethod
    def of(cls, body: Body, cut: Cut, garments: tuple[str, ...]) -> FoundCut:
        """`garments` on `body` with this `cut`."""
        numbers = cut.array()
        numbers[_LOGS] = np.log(numbers[_LOGS])
        return cls(body, numbers, garments)

    @property
    def cut(self) -> Cut:
        """In its own units."""
        return _cut(self.numbers)

    def tubes(self, numbers: Float[Array, "P"] | None = None) -> Tubes:
        """Of this cut, or of the one with other `numbers`."""
        cut = _cut(self.numbers if numbers is None else numbers)
        return cut_tubes(self.body, cut, self.garments)


def find_cut(sequence: Sequence) -> FoundCut | None:
    """The person's loose clothes; None for tight ones, or where what the masks show beyond the body
    is no such cloth."""
    if not sequence.body.has_surface or len(sequence.train) < _LEAST_FRAMES:
        return None
    few = Outlines.of(sequence, _FEW)
    if few.beyond < _LOOSE:
        return None
    drawn = _Fit(sequence.body, few).drawn()
    return None if drawn is None else _Fit(sequence.body, Outlines.of(sequence)).found(drawn)


class _Fit:
    """Gauss-Newton on blurred outlines."""

    def __init__(self, body: Body, outlines: Outlines) -> None:
        self._body, self._outlines = body, outlines

    def drawn(self) -> FoundCut | None:
        """The best of some random cuts of all garments; None where none is promising."""
        rng = np.random.default_rng(0)
        usual = FoundCut.of(self._body, Cut(), (SKIRT, SLEEVES))
        drawn = [usual.numbers, *rng.uniform(_LIKELY_LOW, _LIKELY_HIGH, (_DRAWS, len(_LOW)))]
        left = [_squares(self._residual(usual, one, _BLURS_PX[0])) for one in drawn]
        best = int(np.argmin(left))
        of_body = _squares(self._blurred(None, _BLURS_PX[0]))
        if left[best] > (1.0 - _PROMISING) * of_body:
            return None
        return replace(usual, numbers=drawn[best])

    def found(self, begun: FoundCut) -> FoundCut | None:
        """What is worn of what `begun` has, in the cut that fits best; None: too little of the
        masks is explained by it."""
        both, numbers, coarse_px = begun.garments, begun.numbers, _BLURS_PX[0]
        for blur_px in _BLURS_PX:
            numbers = descended(
                lambda one, px=blur_px: self._residual(begun, one, px), numbers, _ROUNDS
            )
        found = replace(begun, numbers=numbers)
        of_body = _squares(self._blurred(None, coarse_px))
        left = _squares(self._residual(found, numbers, coarse_px))
        worn = []
        for garment in both:
            others = tuple(other for other in both if other != garment)
            without = replace(found, garments=others)
            if _squares(self._residual(without, numbers, coarse_px)) - left > _NEEDED * of_body:
                worn.append(garment)
        if not worn:
            return None
        found = replace(found, garments=tuple(worn))
        left = _squares(self._residual(found, numbers, coarse_px))
        return found if left < (1.0 - _EXPLAINED) * of_body else None

    def _blurred(self, tubes: Tubes | None, blur_px: float) -> Float[Array, "F H W"]:
        from scipy.ndimage import gaussian_filter

        differences = self._outlines.differences(tubes)
        return gaussian_filter(differences, (0.0, blur_px, blur_px))

    def _residual(
        self, found: FoundCut, numbers: Float[Array, "P"], blur_px: float
    ) -> Float[Array, "R"]:
        return self._blurred(found.tubes(numbers), blur_px).ravel()


def descended(
    residual: Callable[[Float[Array, "P"]], Float[Array, "R"]],
    numbers: Float[Array, "P"],
    rounds: int,
) -> Float[Array, "P"]:
    """`numbers` of a cut after at most so many damped steps of Gauss-Newton
    (Levenberg-Marquardt)."""
    damping, now = 1e-2, residual(numbers)
    for _ in range(rounds):
        columns = []
        for number, step in enumerate(_STEPS):
            varied = numbers.copy()
            varied[number] += step if varied[number] + step <= _HIGH[number] else -step
            columns.append((residual(varied) - now) * (step / (varied[number] - numbers[number])))
        slopes = np.stack(columns, axis=1)
        normal, pull, before = slopes.T @ slopes, -slopes.T @ now, _squares(now)
        diagonal = np.diag(np.diag(normal) + 1e-6 * np.trace(normal) + 1e-9)
        for _ in range(_ATTEMPTS):
            step = np.linalg.solve(normal + damping * diagonal, pull)
            step = np.clip(step, -_FARTHEST, _FARTHEST) * _STEPS
            tried = np.clip(numbers + step, _LOW, _HIGH)
            after = residual(tried)
            if _squares(after) < before:
                break
            damping = max(5.0 * damping, 0.05)
        else:
            return numbers
        damping = max(0.3 * damping, 1e-3)
        numbers, now = tried, after
        if _squares(now) > (1.0 - _LEAST_GAIN) * before:
            break
    return numbers


def _cut(numbers: Float[Array, "P"]) -> Cut:
    numbers = numbers.copy()
    numbers[_LOGS] = np.exp(numbers[_LOGS])
    return Cut.of(numbers)


def _squares(residual: Float[Array, "..."]) -> float:
    return float(np.vdot(residual, residual))
