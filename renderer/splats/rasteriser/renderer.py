"""Draws any number of people's splats into one picture; they hide each other splat by splat."""

from __future__ import annotations

from collections.abc import Sequence as Many
from dataclasses import dataclass

import numpy as np

from renderer.relighting.shading import Relighting, normals_of
from renderer.splats.cloth.hanging import HungCloth
from renderer.splats.expressions import BlendShapes
from renderer.splats.layout import (
    BLUE,
    BOX_FILTER_PX2,
    COLOUR,
    HIDDEN_LOGIT,
    MEAN_X,
    MEAN_Y,
    OPACITY,
    RED,
    TILE,
)
from renderer.splats.rasteriser.laying import Laying, values_to_blend
from renderer.splats.rasteriser.workspace import Workspace, pack_camera
from renderer.splats.skinned import SkinnedSplats
from scene.arrays import Array, Bool, Float
from scene.camera import Camera
from scene.lighting import Lighting
from scene.live_appearance import LaidPicture, LiveAppearance
from scene.skeleton import CHEST

_COLOURS = slice(COLOUR, COLOUR + 3)
_MEAN = np.full(3, 1.0 / 3.0, np.float32)
_DARK, _MOST_GAIN = 0.02, 2.0
"""sRGB below which a colour tells nothing about light, and by how much a room's light enlarges a
live change at most."""


@dataclass(frozen=True, eq=False)
class LaidOnModel:
    """A picture that is laid on one of the models."""

    rows: slice
    """Of all splats, the model's."""
    laid: LaidPicture
    laying: Laying


@dataclass(frozen=True, eq=False)
class Geometry:
    """Where the people of a picture are; all premultiplied: divided by `alpha` it is the mean of
    what shows in a pixel, each splat counted as much as its colour is."""

    depth: Float[Array, "H W"]
    """Along the camera's axis, m."""
    normal: Float[Array, "H W 3"]
    """Outwards, world; between nil and unit length before it is premultiplied."""
    alpha: Float[Array, "H W"]


class SplatRenderer:
    """Renders a set of models; keep it as long as the set stays."""

    def __init__(self, models: Many[SkinnedSplats]) -> None:
        offsets = np.cumsum([0] + [len(m.skeleton.names) for m in models])
        self._parameters = np.concatenate([m.parameters for m in models]).astype(np.float32)
        self._weights = np.concatenate([m.weights for m in models]).astype(np.float32)
        # two performers have 48 joints: one table of transforms serves all
        self._joints = np.concatenate(
            [m.joints.astype(np.uint16) + o for m, o in zip(models, offsets, strict=False)]
        ).astype(np.uint16)
        self._models = tuple(models)
        self._relighting: Relighting | None = None
        self._has_light = any(model.light is not None for model in models)
        self._relit = self._as_captured = self._parameters
        self._blend_shapes = BlendShapes(models)
        self._cloth = HungCloth(models)
        self._opacity = self._parameters[:, OPACITY].copy()
        self._drawn = np.ones(len(self._parameters), bool)
        self._workspace = Workspace(len(self._parameters))
        self._out = np.zeros((0, 0, 4), np.float32)

    def render(
        self,
        camera: Camera,
        transforms: Many[Float[Array, "K 4 4"]],
        lighting: Lighting | None = None,
        placements: Many[Float[Array, "4 4"]] | None = None,
        expressions: Many[Float[Array, "E"]] | None = None,
        appearances: Many[LiveAppearance | None] | None = None,
        hung: Many[Float[Array, "V 3"] | None] | None = None,
    ) -> Float[Array, "H W 4"]:
        """Premultiplied sRGB and alpha.

        Args:
            camera: its distortion, if any, is not drawn.
            transforms: per model, skinning transforms (rest -> world) with its placement.
            lighting: falls on all models; None shows each in the light of its own clip, where the
                model holds it.
            placements: per model, from the world of its clip to this one, as it is part of
                `transforms`; None: they are the same. The light of a clip goes with it.
            expressions: per model, its expression (`scene.expression`); None: at rest.
            appearances: per model, how its person looks now (`renderer.live_look`); None: as
                captured.
            hung: per model, how its loose clothes hang (`renderer.splats.cloth.hanging`); None: as
                at rest.
        Returns:
            float32 buffer that the next call overwrites.
        """
        moved = np.concatenate(list(transforms)).astype(np.float32)
        shown = self.shaded(camera, moved, lighting, placements, expressions, hung)
        colours = None
        if appearances is not None and any(appearances):
            colours = self.changed_colours(shown, [one and one.change for one in appearances])
        layings = self._layings(appearances or [], transforms, camera)
        return self._rasterise(shown, moved, camera, colours, layings)

    def draw_only(self, drawn: Bool[Array, "N"]) -> None:
        """Draw these of all models' splats from now on: those of one level of each."""
        changed = np.flatnonzero(drawn != self._drawn)
        opacity = np.where(drawn[changed], self._opacity[changed], np.float32(HIDDEN_LOGIT))
        for parameters in (self._parameters, self._relit, self._as_captured):
            parameters[changed, OPACITY] = opacity
        self._drawn = drawn

    def shaded(
        self,
        camera: Camera,
        moved: Float[Array, "K 4 4"],
        lighting: Lighting | None = None,
        placements: Many[Float[Array, "4 4"]] | None = None,
        expressions: Many[Float[Array, "E"]] | None = None,
        hung: Many[Float[Array, "V 3"] | None] | None = None,
    ) -> Float[Array, "N P"]:
        """Every splat as it is drawn, before it is skinned: moved by expressions and cloth, and
        lit; arguments as of `render`, the transforms of all models in one array."""
        if self._cloth.any:
            self._cloth.move(self._parameters, hung)
            for lit in (self._relit, self._as_captured):
                if lit is not self._parameters:
                    self._cloth.move(lit, hung)
        if self._blend_shapes.any:
            self._apply_expressions(expressions)
        if lighting is not None:
            return self._relight(moved, camera, lighting)
        if self._has_light:
            return self._light_as_captured(moved, camera, placements)
        return self._parameters

    def changed_colours(
        self, shown: Float[Array, "N P"], changes: Many[Float[Array, "_ 3"] | None]
    ) -> Float[Array, "N 3"]:
        """The colours of splats as `shown`, with the change of each model.

        Changes come from a webcam's picture: they are as much brighter or darker as the room's
        light makes the splat itself."""
        colours, start = shown[:, _COLOURS].copy(), 0
        for model, change in zip(self._models, changes, strict=True):
            rows = slice(start, start + len(model.parameters))
            start = rows.stop
            if change is None:
                continue
            lit, captured = colours[rows] @ _MEAN, self._parameters[rows, _COLOURS] @ _MEAN
            gain = np.clip(lit / np.maximum(captured, _DARK), 0.0, _MOST_GAIN)
            np.clip(colours[rows] + gain[:, None] * change, 0.0, 1.0, out=colours[rows])
        return colours

    def _layings(
        self,
        appearances: Many[LiveAppearance | None],
        transforms: Many[Float[Array, "K 4 4"]],
        camera: Camera,
    ) -> list[LaidOnModel]:
        """What is laid on whom in a view."""
        start, found = 0, list[LaidOnModel]()
        for model, one, moved in zip(self._models, appearances, transforms, strict=False):
            rows = slice(start, start + len(model.parameters))
            start = rows.stop
            if one is None or (laid := one.laid_picture) is None:
                continue
            chest = model.skeleton.rest_joints[CHEST]
            laying = Laying.seen_by(laid, camera, moved[CHEST], chest)
            if laying.strength > 0.0:
                found.append(LaidOnModel(rows, laid, laying))
        return found

    def _lay(self, layings: Many[LaidOnModel], view: Float[Array, "H W 4"]) -> None:
        """Lay their webcams' pictures on the people of `view`, which was drawn last."""
        from renderer.splats.rasteriser.laying_kernels import lay

        for one in layings:
            blended = self._blend_in_view(self._values_of(one))
            lay(view, blended, one.laid.detail, one.laying.scale, one.laying.strength)

    def _values_of(self, one: LaidOnModel) -> Float[Array, "N 3"]:
        """What all models' splats blend to lay one picture."""
        values = np.zeros((len(self._parameters), 3), np.float32)
        values[one.rows] = values_to_blend(one.laid, self._means()[one.rows], one.laying.scale)
        return values

    def _means(self) -> Float[Array, "N 2"]:
        """Where the splats' centres are in the last picture, px; of those that are not in it,
        anything."""
        return self._workspace.projected[:, MEAN_X : MEAN_Y + 1]

    def _blend_in_view(self, values: Float[Array, "N 3"]) -> Float[Array, "H W 4"]:
        """The last picture, of `values` in place of colours."""
        return self._blend(values)

    def _apply_expressions(self, expressions: Many[Float[Array, "E"]] | None) -> None:
        """Move the splats of face and hands; shading depends on their positions."""
        self._blend_shapes.show(expressions)
        self._blend_shapes.move(self._parameters)
        for lit in (self._relit, self._as_captured):
            if lit is not self._parameters:
                self._blend_shapes.move(lit)

    def _rasterise(
        self,
        parameters: Float[Array, "N P"],
        moved: Float[Array, "K 4 4"],
        camera: Camera,
        colours: Float[Array, "N 3"] | None = None,
        layings: Many[LaidOnModel] = (),
    ) -> Float[Array, "H W 4"]:
        """The picture of splats with these `parameters`, skinned by `moved`; with `colours` in
        place of theirs, and with pictures laid on."""
        import numba

        from renderer.splats.rasteriser.laying_kernels import draw_and_lay
        from renderer.splats.rasteriser.tile_kernels import draw

        if self._out.shape[:2] != (camera.height, camera.width):
            self._out = np.zeros((camera.height, camera.width, 4), np.float32)
        work = self._workspace
        work.arrange(
            parameters,
            self._joints,
            self._weights,
            moved,
            pack_camera(camera),
            camera.width,
            camera.height,
            BOX_FILTER_PX2,
        )
        if colours is not None:
            work.projected[:, RED : BLUE + 1] = colours
        lists, threads = (work.projected, work.starts, work.entries), numba.get_num_threads()
        if not layings:
            draw(*lists, threads, self._out)
            return self._out
        first, *others = layings
        scale, strength = first.laying.scale, first.laying.strength
        values = self._values_of(first)
        draw_and_lay(*lists, values, first.laid.detail, scale, strength, threads, self._out)
        self._lay(others, self._out)
        return self._out

    def geometry(self, transforms: Many[Float[Array, "K 4 4"]]) -> Geometry:
        """Of the picture that was rendered last, by the same `transforms`."""
        work = self._workspace
        depth = self._blend(np.broadcast_to(work.depth[:, None], (len(work.depth), 3)))
        turns = np.concatenate(list(transforms))[self._joints, :3, :3]
        rest = np.concatenate([normals_of(model) for model in self._models])
        normals = np.einsum("nk,nkij,nj->ni", self._weights, turns, rest)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
        shown = self._blend(normals)
        return Geometry(depth[..., 0], shown[..., :3], shown[..., 3])

    def _blend(self, values: Float[Array, "N 3"]) -> Float[Array, "H W 4"]:
        """A picture of `values` in place of colours, and alpha."""
        import numba

        from renderer.splats.rasteriser.tile_kernels import draw

        work, out = self._workspace, np.empty_like(self._out)
        projected = work.projected.copy()
        projected[:, RED : BLUE + 1] = values
        draw(projected, work.starts, work.entries, numba.get_num_threads(), out)
        return out

    @property
    def tiles(self) -> Bool[Array, "tH tW"]:
        """Tiles of the last picture that any splat covers."""
        height, width = self._out.shape[:2]
        return (np.diff(self._workspace.starts) > 0).reshape(-(-height // TILE), -(-width // TILE))

    def _relight(
        self, transforms: Float[Array, "K 4 4"], camera: Camera, lighting: Lighting
    ) -> Float[Array, "N P"]:
        """The parameters with colours as they are in `lighting`."""
        if self._relit is self._parameters:
            self._relit = self._parameters.copy()
        self._get_relighting().shade(
            self._relit, self._joints, self._weights, transforms, camera.position, lighting
        )
        return self._relit

    def _light_as_captured(
        self,
        transforms: Float[Array, "K 4 4"],
        camera: Camera,
        placements: Many[Float[Array, "4 4"]] | None,
    ) -> Float[Array, "N P"]:
        """The parameters with colours in the light of each model's own clip."""
        if self._as_captured is self._parameters:
            self._as_captured = self._parameters.copy()
        self._get_relighting().shade_as_captured(
            self._as_captured,
            self._joints,
            self._weights,
            transforms,
            camera.position,
            placements or [np.eye(4)] * len(self._models),
        )
        return self._as_captured

    def _get_relighting(self) -> Relighting:
        if self._relighting is None:
            self._relighting = Relighting(self._models)
        return self._relighting
