"""Trains splats from the frames: one frame a step over a random background, Huber's loss, Adam.

Distilled from a trained field they come within 0.3 dB of the field, 1.4 dB below those trained on
the frames for as long; from both, 0.7 dB below (`metanerf bench distil`).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from renderer.person_frames import frames_with_person
from renderer.pose_refinement.clip_poses import PoseRefinement
from renderer.pose_refinement.drift_guard import DriftGuard
from renderer.pose_refinement.passes import RefinementPasses
from renderer.pose_refinement.photometry import SkinnedPoints
from renderer.relighting.captured_light import CapturedLight
from renderer.splats.cloth.hanging import NO_CLOTH
from renderer.splats.layout import COLOUR, POSITION, ROTATION
from renderer.splats.model import SplatModel
from renderer.splats.settings import SplatSettings
from renderer.splats.training import frame_drawing
from renderer.splats.training.densification import Densification, splat_errors, to_split
from renderer.splats.training.evidence import (
    Evidence,
    frames_looked_at,
    shown_pixels,
    surface_cosines,
)
from renderer.splats.training.filling import held_colours
from renderer.splats.training.finer_sides import finer_layer, wide_on_unseen_sides
from renderer.splats.training.finger_bends import FingerBends
from renderer.splats.training.hair import Hair
from renderer.splats.training.initialisation import FirstSplats, first_splats, splats_of_model
from renderer.splats.training.loose_clothes import ClipCloth, with_splats_on_cloth
from renderer.splats.training.merging import Grouping
from renderer.splats.training.occlusion import hidden_by_limbs
from renderer.splats.training.resizing import Resizing
from renderer.splats.training.smooth_skin import smooth_skin
from renderer.splats.training.step_views import StepViews
from renderer.splats.training.strands import with_strands
from renderer.splats.training.strays import strays_on_hands
from renderer.splats.training.trained_splats import TrainedSplats, adam_rates
from renderer.splats.training.unseen_sides import far_sides, guess_sides
from renderer.splats.training.views import View, read_views
from scene.arrays import Array, Bool, Float, Int
from scene.motion import Motion
from scene.sequence import PoseTrust, Sequence
from scene.skeleton import Skeleton

_DENSIFIED_FROM = 0.25
"""Share of the training after which coarse splats give way to finer ones."""
_LIGHT_FROM = 0.3
"""Share of the training after which the light is estimated."""


class SplatTrainer:
    """Trains one `SplatModel` (a `Trainer`)."""

    def __init__(
        self,
        sequence: Sequence,
        settings: SplatSettings,
        seed: int,
        start: SplatModel | None = None,
        *,
        find_light: bool = False,
    ) -> None:
        import numba

        filmed = read_views(sequence.train)
        shown = frames_with_person(bool(view.rgba[..., 3].any()) for view in filmed)
        sequence, filmed = sequence.part(shown), [filmed[frame] for frame in shown]
        self._sequence, self._settings = sequence, settings
        self._find_light = find_light
        self._found: Evidence | None = None
        self._held = np.zeros(0, bool)
        self._far_sides = np.zeros(0, bool)
        self._hair = Hair.none(0)
        self._light: CapturedLight | None = None
        self._rng = np.random.default_rng(seed)
        self._looks = StepViews(filmed, sequence, settings)
        self._views = self._looks.whole
        first = first_splats(sequence, settings, self._rng)
        self._poses = PoseRefinement(sequence, start)
        self._cloth = self._clothes(sequence, start)
        if self._cloth is not None:
            tubes = self._cloth.begun
            first = with_splats_on_cloth(first, tubes, sequence.body, settings, self._rng)
        self._first_skeleton = self._poses.skeleton
        earlier = None if start is None else splats_of_model(start, first, self._first_skeleton)
        planned = Densification.planned(first, earlier, settings)
        self._resizing = Resizing(first if earlier is None else earlier, planned)
        self.held_out: tuple[int, ...] = ()
        """Frames that steps do not look at; may be set."""
        self.adds_sides = True
        """Sides that no frame shows get more splats; may be set."""
        self._bends = FingerBends(sequence, start)
        self.splats = self._splats_begun()
        self._passes = (
            RefinementPasses(self._views, colours_known=start is not None)
            if self._poses.active
            else None
        )
        given = sequence.pose_trust is PoseTrust.GIVEN
        self._guard = DriftGuard(len(self._views), active=given)
        self._rates = adam_rates(settings, exact=sequence.pose_trust is PoseTrust.EXACT)
        self._rate_factor = np.ones(1, np.float32)
        self._queue: list[int] = []
        self._losses = np.zeros(numba.get_num_threads())
        self._estimated = sequence.pose_trust is PoseTrust.ESTIMATED
        self._linear_from = (
            settings.uncertain_linear_from if self._estimated else settings.linear_from
        )

    def _splats_begun(self) -> TrainedSplats:
        first, expressions = self._resizing.splats, self._bends.expressions
        return TrainedSplats(first, self._first_skeleton, expressions, self._settings, self._cloth)

    def _clothes(self, sequence: Sequence, start: SplatModel | None) -> ClipCloth | None:
        """Loose ones; those of an earlier model are known."""
        if start is None:
            return ClipCloth.found(sequence)
        if start.cloth is None:
            return None
        return ClipCloth(start.cloth, self._poses.motion(), self._poses.skeleton)

    @property
    def frames(self) -> int:
        """Of the clip."""
        return len(self._views)

    def warm_up(self) -> None:
        """Compile the kernels by one step whose effect is undone."""
        before = self.state()
        self.step(0.0)
        self.preview()
        self.restore(before)

    def before_step(self, fraction: float) -> None:
        """Make coarse splats finer; estimate the light, once splats have the person's colours;
        later, register the frames, and fill the sides that no frame shows."""
        if (planned := self._resizing.awaited) is not None and fraction >= _DENSIFIED_FROM:
            self._densify(planned)
        if self._cloth is not None and self._cloth.due(fraction):
            self._cloth.refine(self._difference, self.splats, *self._moved())
            self.splats.wear(self._cloth)
        if self._looks.should_register(fraction):
            self._looks.register(self.pictures(frame) for frame in range(self.frames))
        if self._found is None and fraction >= self._settings.filled_from:
            self._fill()
        if not self._find_light or self._light is not None or fraction < _LIGHT_FROM:
            return
        from renderer.relighting.light_estimation import estimate_light

        self._light = estimate_light(self.model_so_far(), self._sequence)
        self._find_light = self._light is not None
        if self._light is not None:
            self.splats.parameters = self._light.without_light(self.splats.parameters)

    def step(self, fraction: float) -> float:
        """Refine the poses, where that is due, and learn from one frame; returns the mean loss of a
        channel."""
        if self._passes is not None and self._passes.should_run(fraction):
            self._refine_poses(self._passes, fraction)
        return self.learn(fraction)

    def learn(self, fraction: float) -> float:
        """Render one frame, compare, update the visible splats; returns as `step`."""
        from renderer.splats.rasteriser.projection_kernels import chain_rule

        if not self._queue:
            if self._estimated and fraction > 0.0:
                self.splats.smooth_displacement()
            shown = np.setdiff1d(self._guard.trained, self.held_out)
            self._queue = self._rng.permutation(shown).tolist()
        frame = self._queue.pop()
        background = self._rng.uniform(size=3).astype(np.float32)
        transforms, splats = self._poses.transforms(frame), self.splats
        view = self._looks.drawn(frame, splats, transforms, fraction, self._rng)
        drawn, shown = self._draw(frame, view, background, transforms)
        chain_rule(
            drawn,
            splats.joints,
            splats.weights,
            transforms,
            view.camera,
            splats.work.projected,
            splats.work.boxes,
            splats.by_projected,
            len(self._losses),
            splats.by_parameter,
        )
        if self._estimated:
            self._bends.learn(frame, splats.expressions, splats.by_parameter, fraction)
        splats.expressions.take_back(splats.by_parameter, frame)
        if self._light is not None:
            self._light.chain_to_albedo(splats.by_parameter, splats.parameters, shown)
        self._leave_out_hidden(view)
        if self._found is not None:
            splats.by_parameter[self._held, COLOUR : COLOUR + 3] = 0.0
        moved = splats.update(self._rates * self._rate_factor[0] * self._falling(fraction))
        if self._estimated:
            splats.pull_to_surface(moved, 1.0 - fraction)
            splats.pull_to_neighbours(moved)
            splats.pull_hands(moved)
        return float(self._losses.sum()) / (3.0 * view.rgba[..., 0].size)

    def _draw(
        self,
        frame: int,
        view: View,
        background: Float[Array, "3"],
        transforms: Float[Array, "K 4 4"],
    ) -> tuple[Float[Array, "N P"], Float[Array, "N P"]]:
        """Render `view` of `frame` and compare: fills the gradients of projected splats, and the
        losses; returns as `arrange`."""
        arranged = frame_drawing.arrange(self.splats, self._light, frame, view, transforms)
        frame_drawing.compare(self.splats, view, background, self._linear_from, self._losses)
        return arranged

    def _moved(self) -> tuple[Motion, Skeleton]:
        """The poses, and the skeleton that is in them."""
        return self._poses.motion(), self._poses.skeleton

    def _difference(self, frame: int) -> Float[Array, "H W 4"]:
        """Between the model in `frame` and the frame, as of `pictures`."""
        made, truth = self.pictures(frame)
        return made - truth

    def _leave_out_hidden(self, view: View) -> None:
        """Far sides, once they are closed, contribute nothing; nor do splats that a limb may hide,
        where poses are estimated."""
        splats, size = self.splats, view.rgba.shape[:2]
        if self._found is not None:
            splats.contribution[self._far_sides] = 0.0
        if self._estimated:
            hidden = hidden_by_limbs(splats.work, splats.limbs, size, view.window.focal_px)
            splats.contribution[hidden] = 0.0

    def _densify(self, planned: Densification) -> None:
        """Make the splats finer that pictures still differ from."""
        split = to_split(self._splat_errors(frame) for frame in frames_looked_at(len(self._views)))
        trained = self.splats.parameters
        self._resizing.split(split)
        self._resize(lambda surface: planned.parameters(split, trained, surface))

    def _fill(self) -> None:
        """Guess the colours of sides that no frame shows, and make these sides finer."""
        self._found = self._evidence()
        frames = frames_looked_at(len(self._views)) if self._sequence.body.has_surface else ()
        shown = ((self._views[frame], self._poses.transforms(frame)) for frame in frames)
        hair = guess_sides(self.splats, self._found, shown, self._poses.skeleton)
        filled = self.splats.parameters
        split = wide_on_unseen_sides(filled, self._found.seen)
        split &= self.splats.first.quads == NO_CLOTH
        may_add = self.adds_sides and self._resizing.refinable and self._sequence.body.has_surface
        if may_add and split.any():
            planned = Densification(self.splats.first, self._finer_layer())
            origins = planned.origins(split)
            self._found, hair = self._found.taken(origins), hair.taken(origins)
            if self._light is not None:
                self._light = self._light.merged(lambda values: values[origins])
            self._resizing.refine(planned, split)
            self._resize(lambda surface: planned.parameters(split, filled, surface))
        self.splats.raise_hair(hair)
        self._hair = hair
        if self._estimated and self._sequence.body.has_surface:
            self.splats.span_hollows(self._found.seen)
        places = self.splats.parameters[:, POSITION : POSITION + 3]
        self._far_sides = far_sides(places, self._found, self.splats.kinds)
        self.splats.close(self._far_sides)
        self._held = held_colours(self._found, self.splats.kinds, self.splats.first.normals)
        self.splats.hold_colours(self._held)

    def _finer_layer(self) -> FirstSplats:
        return finer_layer(self._sequence.body, self._settings.thickness)

    def merge(self, grouping: Grouping) -> None:
        """Go on with one splat for each group."""
        trained = self.splats.parameters
        self._resizing.merge(grouping)
        if self._light is not None:
            self._light = self._light.merged(grouping.mean)
        turns = self._resizing.splats.parameters[:, ROTATION : ROTATION + 4]
        self._resize(lambda _: grouping.merged(trained, turns))

    def _resize(self, parameters: Callable[[Float[Array, "N P"]], Float[Array, "N P"]]) -> None:
        """Go on with the splats that are now in order; `parameters` takes their surface."""
        self.splats = self._splats_begun()
        self.splats.surface_on(self._poses.skeleton)
        self.splats.parameters = parameters(self.splats.surface)
        if self._estimated:
            self.splats.smooth_displacement()

    def _splat_errors(self, frame: int) -> tuple[Float[Array, "N"], Float[Array, "N"]]:
        light = self.light(frame)
        self._leave_out_hidden(self._views[frame])
        return splat_errors(self.splats.work, light, *self._arranged(self._views[frame]))

    def light(self, frame: int) -> Float[Array, "N"]:
        """Light that each splat blends into `frame`, px."""
        black = np.zeros(3, np.float32)
        self._draw(frame, self._views[frame], black, self._poses.transforms(frame))
        return self.splats.contribution

    def pictures(self, frame: int) -> tuple[Float[Array, "H W 4"], Float[Array, "H W 4"]]:
        """The model in `frame`, and the frame; premultiplied sRGB, in the size of whole views."""
        view = self._views[frame]
        frame_drawing.arrange(self.splats, self._light, frame, view, self._poses.transforms(frame))
        return self._arranged(view)

    def _arranged(self, view: View) -> tuple[Float[Array, "H W 4"], Float[Array, "H W 4"]]:
        """A picture of what was arranged for `view`, and what that shows."""
        made = frame_drawing.picture(self.splats, view, len(self._losses))
        return made, frame_drawing.truth(view)

    def front(self, frame: int) -> Int[Array, "H W"]:
        """Which splat each pixel of whole views shows in `frame`; -1 where none does."""
        return frame_drawing.front(
            self.splats, frame, self._views[frame], self._poses.transforms(frame)
        )

    def _refine_poses(self, passes: RefinementPasses, fraction: float) -> None:
        """One pass over the clip, while the model stays true to given poses; splats follow
        changed bone lengths."""
        if self._guard.has_drifted(self._error_in_given_pose):
            self._poses.go_back()
            passes.end()
            return
        splats = self.splats
        points = SkinnedPoints(
            splats.parameters[:, POSITION : POSITION + 3], splats.joints, splats.weights
        )
        before = self._poses.skeleton
        self._poses.apply_step(
            passes.equations(
                points,
                self._as_captured(splats.parameters),
                self._poses,
                fraction,
                splats.expressions,
            )
        )
        splats.follow_bones(before, self._poses.skeleton)
        if self._cloth is not None:
            self._cloth.hang(*self._moved())
            splats.wear(self._cloth)

    def _error_in_given_pose(self, frame: int) -> float:
        """Mean loss of a channel in the pose that the sequence gives `frame`, over black."""
        view, black = self._views[frame], np.zeros(3, np.float32)
        self._draw(frame, view, black, self._poses.given_transforms(frame))
        return float(self._losses.sum()) / (3.0 * view.rgba[..., 0].size)

    def preview(self) -> Float[Array, "H W 3"]:
        """The first training view, over light grey."""
        hung = None if self._cloth is None else self._cloth.hung[0]
        return frame_drawing.preview(
            self.model_so_far(),
            self._sequence.train.camera(0),
            self._poses.transforms(0),
            self._bends.expressions[0],
            hung,
        )

    def model_so_far(self) -> SplatModel:
        """As it is now, all of it taken as seen."""
        seen = np.ones(len(self.splats), bool)
        return self._model(self.splats.parameters, seen, {})

    def state(self) -> dict[str, Array]:
        """Parameters, moments, refined poses and the random state."""
        rng_state = json.dumps({"rng": self._rng.bit_generator.state, "queue": self._queue})
        return {
            **self.splats.state(),
            **self._resizing.state(),
            "slower": self._rate_factor.copy(),
            "chance": np.array(rng_state),
            **self._poses.state(),
            **self._bends.state(),
            **self._guard.state(),
            **self._looks.state(),
            **(self._passes.state() if self._passes else {}),
            **(self._light.state() if self._light else {}),
            **(self._cloth.state() if self._cloth else {}),
        }

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`. Raises OutdatedCheckpoint where it began with other splats."""
        self._resizing.restore(state, self._finer_layer)
        self._poses.restore(state)
        self._bends.restore(state)
        if self._cloth is not None:
            self._cloth.restore(state, *self._moved())
        self.splats = self._splats_begun()
        self.splats.restore(state)
        self.splats.surface_on(self._poses.skeleton)
        self._rate_factor = state["slower"].copy()
        rng_state = json.loads(str(state["chance"]))
        self._rng.bit_generator.state, self._queue = rng_state["rng"], list(rng_state["queue"])
        self._light, self._found = CapturedLight.restored(state), None
        self._guard.restore(state)
        self._looks.restore(state)
        if self._passes is not None:
            self._passes.restore(state)

    def halve_learning_rate(self) -> None:
        """Halve all rates."""
        self._rate_factor *= 0.5

    def finish(self, metrics: dict[str, Any]) -> SplatModel:
        """The model, with unseen splats filled in: now, where no step came late enough for it, as
        on a machine where a pass over all poses took the rest of the time. Filled once more, what
        lies behind lips and lids would change, and shine through them."""
        if self._found is None:
            self._fill()
        evidence, splats = self._found, self.splats
        assert evidence is not None
        parameters = splats.parameters
        if self._estimated:
            parameters = smooth_skin(parameters, evidence, splats.kinds, self._hair.covered)
        seen = evidence.seen
        seen_share = round(float(seen.mean()), 4)
        model = self._model(parameters, seen, {**metrics, "seen_share": seen_share})
        if self.adds_sides:
            model = with_strands(model, self._hair)
        return replace(model, metrics={**model.metrics, "splats": len(model)})

    def _model(
        self, parameters: Float[Array, "N P"], seen: Bool[Array, "N"], metrics: dict[str, Any]
    ) -> SplatModel:
        poses, data_hash = self._poses, self._sequence.data_hash
        motion = replace(poses.motion(), expressions=self._bends.expressions.copy())
        model = self.splats.model(parameters, seen, poses.skeleton, motion, data_hash)
        return replace(self._light.lit(model) if self._light else model, metrics=metrics)

    def _as_captured(self, parameters: Float[Array, "N P"]) -> Float[Array, "N P"]:
        """`parameters` with colours as captured, also while albedos are trained."""
        return parameters if self._light is None else self._light.with_mean_light(parameters)

    def _evidence(self) -> Evidence:
        """How well pixels determine each splat's colour."""
        shown, cosines = [], []
        for frame in frames_looked_at(len(self._views)):
            view, transforms = self._views[frame], self._poses.transforms(frame)
            light = self.light(frame)
            self._leave_out_hidden(view)
            shown.append(shown_pixels(self.splats.work, light))
            facing = surface_cosines(self.splats.first, transforms, view.window.position)
            # cloth turns as it swings, and is seen from within too
            cosines.append(np.where(self.splats.first.quads == NO_CLOTH, facing, 1.0))
        found = Evidence.of_frames(np.stack(shown), np.stack(cosines))
        splats = self.splats
        return found.without(
            strays_on_hands(splats.parameters, found, splats.joints, splats.weights)
        )

    def _falling(self, fraction: float) -> np.float32:
        """What rates fall to."""
        return np.float32(1.0 - (1.0 - self._settings.last_rate_share) * fraction)
