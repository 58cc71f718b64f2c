"""The splats of a training as they are now, with Adam's moments and the arrays a step works in."""

from __future__ import annotations

import numpy as np

from renderer.splats.expressions import ClipBlendShapes
from renderer.splats.layout import COLOUR, CONTRIBUTION, PARAMETERS, POSITION, PROJECTED, ROTATION
from renderer.splats.rasteriser.workspace import Workspace
from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import FirstSplats, moved_with_bones
from renderer.splats.training.occlusion import limb_splats
from renderer.splats.training.surface_kinds import surface_kinds
from scene.arrays import Array, Bool, Float
from scene.skeleton import Skeleton

_MIN_CONTRIBUTION = 0.02
"""Summed blending weight, in pixels, from which a step moves a splat."""
_SHAPE = slice(POSITION, ROTATION + 4)


class TrainedSplats:
    """As many splats as `first` has; another number needs another of these."""

    def __init__(
        self,
        first: FirstSplats,
        skeleton: Skeleton,
        expressions: Float[Array, "F E"],
        settings: SplatSettings,
    ) -> None:
        """Args:
        skeleton: the one that `first` lies on.
        expressions: of each frame.
        """
        import numba

        self.first, self._first_skeleton, self._settings = first, skeleton, settings
        self.parameters, self.surface = first.parameters.copy(), first.parameters
        self.joints, self.weights = first.joints, first.weights
        self.expressions = ClipBlendShapes(
            first.expression_splats, first.expression_offsets, expressions
        )
        rest = first.parameters[:, POSITION : POSITION + 3]
        self.kinds = surface_kinds(rest, self.joints, self.weights, skeleton)
        self.limbs = limb_splats(self.joints, self.weights)
        count, threads = len(self), numba.get_num_threads()
        self.work = Workspace(count)
        self.thread_gradients = np.zeros((threads, count, PROJECTED), np.float32)
        self.by_projected = np.zeros((count, PROJECTED), np.float32)
        self.by_parameter = np.zeros((count, PARAMETERS), np.float32)
        self._first_moment = np.zeros_like(self.parameters)
        self._second_moment = np.zeros_like(self.parameters)
        self._steps = np.zeros(count, np.int32)

    def __len__(self) -> int:
        return len(self.first.parameters)

    @property
    def contribution(self) -> Float[Array, "N"]:
        """Summed blending weight of each splat in the frame just drawn, px; may be changed."""
        return self.by_projected[:, CONTRIBUTION]

    def update(self, rates: Float[Array, "P"]) -> Bool[Array, "N"]:
        """Adam's step by the gradient `by_parameter`; returns which splats moved."""
        from renderer.splats.training.adam_kernels import adam_step

        settings = self._settings
        adam_step(
            self.parameters,
            self.by_parameter,
            self.contribution,
            self._first_moment,
            self._second_moment,
            self._steps,
            rates,
            settings.beta1,
            settings.beta2,
            _MIN_CONTRIBUTION,
            np.log(np.array(settings.scale_range_m, np.float32)),
        )
        return self.contribution > _MIN_CONTRIBUTION

    def pull_to_surface(self, moved: Bool[Array, "N"], share: float) -> None:
        """Draw places, sizes and rotations of `moved` back to the surface by `share`."""
        gap = self.surface[moved, _SHAPE] - self.parameters[moved, _SHAPE]
        self.parameters[moved, _SHAPE] += np.float32(share) * gap

    def follow_bones(self, before: Skeleton, after: Skeleton) -> None:
        """Move from the skeleton `before` to the one of other bone lengths `after`."""
        self.parameters = moved_with_bones(
            self.parameters, self.joints, self.weights, before, after
        )
        self.surface_on(after)

    def surface_on(self, skeleton: Skeleton) -> None:
        """Take the surface to be that of `skeleton`."""
        self.surface = self.first.moved(self._first_skeleton, skeleton)

    def hold_colours(self, held: Bool[Array, "N"]) -> None:
        """Forget where the colours of `held` were going to."""
        for moment in (self._first_moment, self._second_moment):
            moment[held, COLOUR : COLOUR + 3] = 0.0

    def state(self) -> dict[str, Array]:
        """What `restore` needs."""
        return {
            "parameters": self.parameters.copy(),
            "first": self._first_moment.copy(),
            "second": self._second_moment.copy(),
            "steps": self._steps.copy(),
        }

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`, of as many splats."""
        self.parameters = state["parameters"].copy()
        self._first_moment, self._second_moment = state["first"].copy(), state["second"].copy()
        self._steps = state["steps"].copy()
        self.thread_gradients[:] = 0.0
