"""The splats of a training as they are now, with Adam's moments and the arrays a step works in."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from renderer.errors import OutdatedCheckpoint
from renderer.splats.cloth.hanging import NO_CLOTH, BoundSplats, WornCloth
from renderer.splats.cloth.tubes import Tubes
from renderer.splats.expressions import ClipBlendShapes
from renderer.splats.layout import (
    COLOUR,
    CONTRIBUTION,
    LOG_SCALE,
    OPACITY,
    PARAMETERS,
    POSITION,
    PROJECTED,
    ROTATION,
)
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.workspace import Workspace
from renderer.splats.settings import SplatSettings
from renderer.splats.training.hair import Hair
from renderer.splats.training.initialisation import FirstSplats, moved_with_bones
from renderer.splats.training.neighbours import mean_of_neighbours
from renderer.splats.training.occlusion import limb_splats
from renderer.splats.training.smooth_hands import SmoothHands
from renderer.splats.training.spanned_hollows import spanned
from renderer.splats.training.surface_kinds import HEAD_KINDS, surface_kinds
from scene.arrays import Array, Bool, Float
from scene.motion import Motion
from scene.skeleton import Skeleton

_MIN_CONTRIBUTION = 0.02
"""Summed blending weight, in pixels, from which a step moves a splat."""
_PLACE = slice(POSITION, POSITION + 3)
_SIZE = slice(LOG_SCALE, LOG_SCALE + 3)
_ROUGHNESS_PULL = 0.1
"""Share of what stands out farther that a step takes back."""
_SMOOTHING_ROUNDS = 10


def adam_rates(settings: SplatSettings, *, exact: bool) -> Float[Array, "P"]:
    """Rates of a splat's parameters at the start; `exact`, where poses are."""
    rates = np.empty(PARAMETERS, np.float32)
    rates[_PLACE] = settings.position_rate if exact else settings.uncertain_position_rate
    rates[LOG_SCALE : LOG_SCALE + 3] = settings.log_scale_rate
    rates[ROTATION : ROTATION + 4] = settings.rotation_rate
    rates[COLOUR : COLOUR + 3] = settings.colour_rate
    rates[OPACITY] = settings.opacity_rate
    return rates


class TrainedSplats:
    """As many splats as `first` has; another number needs another of these."""

    def __init__(
        self,
        first: FirstSplats,
        skeleton: Skeleton,
        expressions: Float[Array, "F E"],
        settings: SplatSettings,
        cloth: WornCloth | None = None,
    ) -> None:
        """Args:
        skeleton: the one that `first` lies on.
        expressions: of each frame.
        cloth: loose clothes; `first` lies on them as they have begun.
        """
        import numba

        self.first, self._first_skeleton, self._settings = first, skeleton, settings
        self.joints, self.weights = first.joints, first.weights
        self._bound_at_first: BoundSplats | None = None
        self.cloth: Tubes | None = None
        self.expressions = ClipBlendShapes(
            first.expression_splats, first.expression_offsets, expressions
        )
        if cloth is not None:
            self._bound_at_first = BoundSplats(first.parameters, first.quads, cloth.begun)
            self._wear(cloth)
        self.surface = self._on_cloth(first.parameters)
        self.parameters = self.surface.copy()
        rest = first.parameters[:, _PLACE]
        self.kinds = surface_kinds(rest, self.joints, self.weights, skeleton)
        # rougher than the rest, since long hair hangs before the chest, yet held more closely to
        # the surface, which landmarks of the face have shaped
        self._on_head = np.isin(self.kinds, HEAD_KINDS)
        pull = np.where(self._on_head, settings.head_shape_pull, settings.shape_pull)
        self._pull = pull.astype(np.float32)
        self.limbs = limb_splats(self.joints, self.weights)
        self.closed = self._held = np.zeros(0, np.int64)
        count, threads = len(self), numba.get_num_threads()
        self.work = Workspace(count)
        self.thread_gradients = np.zeros((threads, count, PROJECTED), np.float32)
        self.by_projected = np.zeros((count, PROJECTED), np.float32)
        self.by_parameter = np.zeros((count, PARAMETERS), np.float32)
        self._first_moment = np.zeros_like(self.parameters)
        self._second_moment = np.zeros_like(self.parameters)
        self._steps = np.zeros(count, np.int32)
        self._displacement = np.zeros(0, np.float32)

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
        self.by_parameter[self._held, COLOUR : COLOUR + 3] = 0.0
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

    def pull_to_surface(self, moved: Bool[Array, "N"], strength: float) -> None:
        """Draw places, sizes and rotations of `moved` back to the surface, by `strength` of what
        the settings say."""
        from renderer.splats.training.pull_kernels import pull_to_surface

        pull_to_surface(self.parameters, self.surface, self._pull, strength, moved)

    def smooth_displacement(self) -> None:
        """Find how far off the surface the neighbourhood of each splat lies, m."""
        away = self._off_surface()
        for _ in range(_SMOOTHING_ROUNDS):
            away = 0.5 * (away + self._neighbourhood @ away)
        self._displacement = away.astype(np.float32)

    def pull_to_neighbours(self, moved: Bool[Array, "N"]) -> None:
        """Take back what stands out of `moved`, once the neighbourhood's place is known: in depth,
        frames from one side leave a splat free."""
        if not len(self._displacement):
            return
        from renderer.splats.training.pull_kernels import pull_to_neighbours

        pull_to_neighbours(
            self.parameters,
            self.surface,
            self.first.normals,
            self._displacement,
            self._on_head,
            self._settings.roughness_m,
            _ROUGHNESS_PULL,
            moved,
        )

    def pull_hands(self, moved: Bool[Array, "N"]) -> None:
        """Keep those of hands that `moved` like their neighbours."""
        self._hands.pull(self.parameters, self.surface, moved)

    def smooth(self) -> Float[Array, "N P"]:
        """Parameters of flat splats on the smooth surface that their neighbourhoods make."""
        if not len(self._displacement):
            self.smooth_displacement()
        smooth, off = self.parameters.copy(), self._displacement - self._off_surface()
        smooth[:, _PLACE] += off[:, None] * self.first.normals
        smooth[:, ROTATION : ROTATION + 4] = self.surface[:, ROTATION : ROTATION + 4]
        return smooth

    def close(self, splats: Bool[Array, "N"]) -> None:
        """Make those `splats`, from now on `closed`, no less opaque than all are at first."""
        self.closed = np.flatnonzero(splats)
        least = np.where(splats, self._settings.opacity_logit, -np.inf)
        self.parameters[:, OPACITY] = np.maximum(self.parameters[:, OPACITY], least)

    def raise_hair(self, hair: Hair) -> None:
        """Let hair stand off the body's surface where it covers sides that no frame shows."""
        rows, surface = hair.covered, self.surface[hair.covered]
        self.parameters[rows, _PLACE] = surface[:, _PLACE] + hair.moves[rows]
        self.parameters[rows, _SIZE] = surface[:, _SIZE] + hair.growth[rows, None]
        self.parameters[rows, OPACITY] = surface[:, OPACITY]

    def span_hollows(self, seen: Bool[Array, "N"]) -> None:
        """Let cloth hang on sides of the trunk that no frame shows; loose clothes do by
        themselves."""
        kinds = np.where(self.first.quads == NO_CLOTH, self.kinds, NO_CLOTH)
        self.parameters[:, _PLACE] += spanned(
            self.parameters[:, _PLACE], self.first.normals, kinds, seen
        )
        self.smooth_displacement()

    def _off_surface(self) -> Float[Array, "N"]:
        """How far splats lie off the surface along its normal, m."""
        from renderer.splats.training.pull_kernels import off_surface

        off = np.empty(len(self), np.float32)
        off_surface(self.parameters, self.surface, self.first.normals, off)
        return off

    @cached_property
    def _neighbourhood(self):
        """See `mean_of_neighbours`."""
        return mean_of_neighbours(self.first.parameters[:, _PLACE])

    @cached_property
    def _hands(self) -> SmoothHands:
        return SmoothHands(self.kinds, self._neighbourhood)

    def follow_bones(self, before: Skeleton, after: Skeleton) -> None:
        """Move from the skeleton `before` to the one of other bone lengths `after`."""
        self.parameters = moved_with_bones(
            self.parameters, self.joints, self.weights, before, after
        )
        self.surface_on(after)

    def surface_on(self, skeleton: Skeleton) -> None:
        """Take the surface to be that of `skeleton`."""
        self.surface = self._on_cloth(
            moved_with_bones(
                self.first.parameters, self.joints, self.weights, self._first_skeleton, skeleton
            )
        )

    def wear(self, cloth: WornCloth) -> None:
        """Go on with `cloth` as it is now: splats lie on it as they did on that of before."""
        before = self.expressions.bound
        assert before is not None
        assert self.cloth is not None
        if cloth.tubes is not self.cloth:
            before.hang(self.parameters, self.parameters[before.rows], cloth.tubes.rest)
        self._wear(cloth)
        self.surface = self._on_cloth(self.first.parameters)

    def _wear(self, cloth: WornCloth) -> None:
        assert self._bound_at_first is not None
        self.cloth, bound = cloth.tubes, self._bound_at_first.on(cloth.tubes)
        self.expressions = replace(self.expressions, bound=bound, hung=cloth.hung)

    def _on_cloth(self, first: Float[Array, "N P"]) -> Float[Array, "N P"]:
        """`first`, which lies on cloth as it has begun, on cloth as it is now."""
        if self._bound_at_first is None or self.cloth is None:
            return first
        moved = first.copy()
        self._bound_at_first.hang(moved, first[self._bound_at_first.rows], self.cloth.rest)
        return moved

    def hold_colours(self, held: Bool[Array, "N"]) -> None:
        """Let the colours of `held` stay as they are."""
        self._held = np.flatnonzero(held)
        for moment in (self._first_moment, self._second_moment):
            moment[self._held, COLOUR : COLOUR + 3] = 0.0

    def model(
        self,
        parameters: Float[Array, "N P"],
        seen: Bool[Array, "N"],
        skeleton: Skeleton,
        motion: Motion,
        data_hash: str,
    ) -> SplatModel:
        """These splats with other `parameters`, as a model by itself."""
        return SplatModel(
            parameters,
            self.joints.astype(np.uint8),
            self.weights,
            seen,
            skeleton,
            motion,
            data_hash,
            expression_splats=self.expressions.splats,
            expression_offsets=self.expressions.offsets,
            cloth=self.cloth,
            quads=self.first.quads,
        )

    def state(self) -> dict[str, Array]:
        """What `restore` needs."""
        return {
            "parameters": self.parameters.copy(),
            "first": self._first_moment.copy(),
            "second": self._second_moment.copy(),
            "steps": self._steps.copy(),
            "displacement": self._displacement.copy(),
        }

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`. Raises OutdatedCheckpoint where it has another number of splats."""
        if len(state["parameters"]) != len(self):
            raise OutdatedCheckpoint(
                f"checkpoint must be of {len(self)} splats, as this version would have by then; "
                f"got {len(state['parameters'])}"
            )
        self.parameters = state["parameters"].copy()
        self._first_moment, self._second_moment = state["first"].copy(), state["second"].copy()
        self._steps = state["steps"].copy()
        self._displacement = state["displacement"].copy()
        self.thread_gradients[:] = 0.0
