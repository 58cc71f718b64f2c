"""Splats on cloth: which lie where on it, and where they are once it hangs and swings.

Cloth is told in the rest frame of the joint that carries it, V vertices *hung* there, so that
splats on it are skinned by that joint alone, as any others are.
"""

from __future__ import annotations

from collections.abc import Sequence as Many
from copy import copy
from dataclasses import dataclass

import numpy as np

from renderer.splats.cloth.tubes import SETTLING_S, STEP_S, Tubes, steps_of
from renderer.splats.layout import POSITION
from renderer.splats.skinned import SkinnedSplats
from scene.arrays import Array, Float, Int
from scene.motion import Motion
from scene.skeleton import Skeleton

NO_CLOTH = -1
"""Quad of splats that lie on no cloth."""
_MOST_STEPS = 30
"""After a longer gap than so many steps cloth settles anew."""


def on_no_cloth(count: int) -> Int[Array, "N"]:
    """Quads of `count` splats on the body."""
    return np.full(count, NO_CLOTH, np.int32)


class BoundSplats:
    """The splats of a model that lie on its cloth."""

    def __init__(
        self, parameters: Float[Array, "N P"], quads: Int[Array, "N"], cloth: Tubes
    ) -> None:
        """Args: parameters: where the cloth is at rest. quads: of `Tubes.quads`, or `NO_CLOTH`."""
        self.rows = np.flatnonzero(quads != NO_CLOTH).astype(np.int32)
        self._corners = np.ascontiguousarray(cloth.quads[quads[self.rows]])
        self._mix = _mix(parameters[self.rows, POSITION : POSITION + 3], cloth.rest[self._corners])
        self._rest = self._surface(cloth.rest)

    def on(self, cloth: Tubes) -> BoundSplats:
        """The same on `cloth` of another cut, with as many vertices."""
        bound = copy(self)
        bound._rest = bound._surface(cloth.rest)
        return bound

    def _surface(self, vertices: Float[Array, "V 3"]) -> tuple[Array, Array]:
        from renderer.splats.cloth.binding_kernels import surface_frames

        count = len(self.rows)
        places, frames = np.empty((count, 3)), np.empty((count, 3, 3))
        surface_frames(vertices, self._corners, self._mix, places, frames)
        return places, frames

    def hang(
        self,
        parameters: Float[Array, "N P"],
        own: Float[Array, "M P"],
        hung: Float[Array, "V 3"],
        first: int = 0,
    ) -> None:
        """Write where `own`, the parameters of `rows` at rest, are on `hung` cloth; `first`: the
        row of `parameters` at which the model begins."""
        from renderer.splats.cloth.binding_kernels import hang

        rows = self.rows + np.int32(first)
        hang(parameters, rows, own, *self._rest, *self._surface(hung))

    def take_back(self, gradient: Float[Array, "N P"], hung: Float[Array, "V 3"]) -> None:
        """Turn a gradient by what `hang` wrote into one by the splats' own parameters."""
        from renderer.splats.cloth.binding_kernels import take_back

        take_back(gradient, self.rows, self._rest[1], self._surface(hung)[1])


def _mix(points: Float[Array, "M 3"], corners: Float[Array, "M 4 3"]) -> Float[Array, "M 2"]:
    """How far to the right and down in its quad each point lies, nearly: 0 to 1."""
    right = 0.5 * (corners[:, 1] - corners[:, 0] + corners[:, 3] - corners[:, 2])
    down = 0.5 * (corners[:, 2] - corners[:, 0] + corners[:, 3] - corners[:, 1])
    off = points - corners.mean(axis=1)
    u, v = ((off * axis).sum(axis=1) / (axis * axis).sum(axis=1) for axis in (right, down))
    return np.clip(0.5 + np.stack([u, v], axis=1), 0.0, 1.0).astype(np.float32)


def hung_from(
    cloth: Tubes, vertices: Float[Array, "V 3"], transforms: Float[Array, "K 4 4"]
) -> Float[Array, "V 3"]:
    """`vertices` in the world, in the rest frames of the joints that carry them.

    Args: transforms: skinning transforms.
    """
    carried = transforms[cloth.carriers]
    away = vertices - carried[:, :3, 3]
    return np.einsum("vji,vj->vi", carried[:, :3, :3].astype(np.float64), away)


@dataclass(frozen=True, eq=False)
class MotionPath:
    """A motion as cloth is simulated over it, and some moments of it."""

    step: Float[Array, "F"]
    """Of the simulation, at each moment; fractions lie between two."""
    transforms: Float[Array, "S K 4 4"]
    posed: Float[Array, "F K 4 4"]
    """Skinning transforms at the moments."""

    @classmethod
    def of(cls, motion: Motion, skeleton: Skeleton, times_s: Float[Array, "F"]) -> MotionPath:
        """`motion`, and its moments `times_s`."""
        steps_s, transforms = steps_of(motion, skeleton)
        poses = [motion.pose_at(float(time_s)) for time_s in times_s]
        posed = skeleton.skinning_transforms(
            np.stack([pose.joint_angles for pose in poses]),
            np.stack([pose.root_translation for pose in poses]),
        )
        return cls(np.interp(times_s, steps_s, np.arange(len(steps_s))), transforms, posed)

    def vertices(self, cloth: Tubes) -> Float[Array, "F V 3"]:
        """Where `cloth` is at the moments, having settled in the first pose, world."""
        simulated = cloth.over(self.transforms)
        before = np.minimum(self.step.astype(int), len(simulated) - 2)
        share = (self.step - before)[:, None, None]
        return (1.0 - share) * simulated[before] + share * simulated[before + 1]

    def hung(self, cloth: Tubes) -> Float[Array, "F V 3"]:
        """How `cloth` hangs at the moments."""
        placed = zip(self.vertices(cloth), self.posed, strict=True)
        return np.stack([hung_from(cloth, vertices, posed) for vertices, posed in placed])


class WornCloth:
    """Somebody's loose clothes in a clip: as splats are spread on them (`begun`), and as they are
    now."""

    def __init__(self, tubes: Tubes, motion: Motion, skeleton: Skeleton) -> None:
        self.begun = self.tubes = tubes
        self.hang(motion, skeleton)

    def hang(self, motion: Motion, skeleton: Skeleton) -> None:
        """Find how they hang in each pose of `motion`."""
        self.hung = MotionPath.of(motion, skeleton, motion.times_s).hung(self.tubes)
        """[F V 3], see `MotionPath`."""


@dataclass(eq=False)
class ClothSwing:
    """One person's cloth as time goes on."""

    cloth: Tubes
    _time_s: float = -np.inf
    _transforms: Float[Array, "K 4 4"] | None = None
    _current: Float[Array, "V 3"] | None = None
    _previous: Float[Array, "V 3"] | None = None

    def hung(self, transforms: Float[Array, "K 4 4"], time_s: float) -> Float[Array, "V 3"]:
        """How it hangs at `time_s`, when the skinning transforms, into any world whose y is up,
        are these; between calls they are taken to change evenly. It settles at once at first, and
        after a gap or where time has gone back."""
        transforms = np.asarray(transforms, np.float64)
        due = (time_s - self._time_s) / STEP_S + 1e-6
        if self._transforms is None or not 0.0 <= due <= _MOST_STEPS:
            self._current = self.cloth.at_rest(transforms)
            self._previous = self._current.copy()
            path, settling, self._time_s = transforms[None], round(SETTLING_S / STEP_S), time_s
        else:
            count = int(due)
            shares = (np.arange(1, count + 1) / due)[:, None, None, None]
            path, settling = (1.0 - shares) * self._transforms + shares * transforms, 0
            self._time_s += count * STEP_S
        assert self._current is not None
        assert self._previous is not None
        if len(path):
            self.cloth.stepped(self._current, self._previous, path, settling)
            self._transforms = path[-1]
        assert self._transforms is not None
        return hung_from(self.cloth, self._current, self._transforms)


class HungCloth:
    """Cloth of a set of models, applied in place."""

    def __init__(self, models: Many[SkinnedSplats]) -> None:
        starts = np.cumsum([0] + [len(model.parameters) for model in models])
        self._bound = [
            None
            if model.cloth is None
            else (int(start), model.cloth, BoundSplats(model.parameters, model.quads, model.cloth))
            for start, model in zip(starts, models, strict=False)
        ]
        self._own = [
            None if bound is None else model.parameters[bound[2].rows].astype(np.float32)
            for bound, model in zip(self._bound, models, strict=True)
        ]

    @property
    def any(self) -> bool:
        """Whether any model has cloth."""
        return any(bound is not None for bound in self._bound)

    def move(
        self, parameters: Float[Array, "N P"], hung: Many[Float[Array, "V 3"] | None] | None
    ) -> None:
        """Write positions and rotations on `hung` cloth of each model into `parameters`; None: it
        is at rest."""
        for number, (bound, own) in enumerate(zip(self._bound, self._own, strict=True)):
            if bound is None or own is None:
                continue
            start, cloth, splats = bound
            now = None if hung is None else hung[number]
            splats.hang(parameters, own, cloth.rest if now is None else now, start)
