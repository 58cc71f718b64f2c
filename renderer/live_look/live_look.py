"""A model's colours as its owner's webcam sees them now.

Where the webcam sees a part of the body, its splats take the colours of the pixels that show them;
where it does not, the trained model goes on, in the exposure of the picture. Colours belong to
splats and not to places in the picture: they move with the body, whatever pose it is drawn in and
from wherever one looks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from renderer.live_look.alignment import FlowAligner
from renderer.live_look.coring import cored, exposure_beside
from renderer.live_look.detail import detail_of
from renderer.live_look.picture import WebcamPicture
from renderer.splats.layout import (
    BLUE,
    BOX_FILTER_PX2,
    COLOUR,
    DIFFERENCE,
    GATHERED,
    KNOWN,
    MEAN_X,
    MEAN_Y,
    POSITION,
    RED,
    SHOWN,
)
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.rasteriser.workspace import Workspace, pack_camera
from renderer.splats.training.evidence import shown_pixels
from renderer.splats.training.occlusion import hidden_by_body, hidden_by_limbs, limb_splats
from scene.arrays import Array, Float, Int
from scene.camera import Camera
from scene.live_appearance import LaidPicture, LiveAppearance
from scene.motion import Pose
from scene.skeleton import CHEST

_COLOURS = slice(COLOUR, COLOUR + 3)
_COLOURS_PX = 256
"""Longest side of the picture that colours are found in: splats are coarser than the pixels of one
that was sent, and those hold what coding leaves."""
_STEPS = 2
"""Steps of colours a picture; what is left is made up for in the next ones."""
_OVERSTEP = 1.7
"""Steps of this length come to the same colours sooner; 2 would never come to rest."""
_KEPT = 0.8
"""Share of the last picture's change with which the next one begins: what no picture asks for any
longer goes."""
_LEAST_PX = 0.05
"""Added to the weight of a splat's pixels: who is hardly shown hardly changes."""
_MOST = 0.5
"""Difference, in sRGB, as which a larger one counts."""
_SEEN = 0.2
"""Share of an open splat's pixels from which one takes all of its live colour."""
_HARDLY = 0.1
"""Share of its live colour below which a splat counts as hidden."""
_OPEN = 95.0
"""Percentile of the pixels shown of splats that is an open one's."""
_NEIGHBOURS = 12
"""Splats from which one that is hardly shown takes its change."""
_HELD_S, _GONE_S = 1.5, 1.0
"""A live colour stays so long after the webcam last saw it, then eases to the trained one."""
_COMES_S = 0.1
"""Time in which a splat that comes into view takes its live colour."""
_EXPOSURE_S = 1.0
"""Time in which the exposure follows the newest picture's."""


@dataclass(frozen=True, eq=False)
class AlignedModel:
    """A model as a picture shows it, but for its colours."""

    pose: Pose
    """Aligned with the picture."""
    captured: Float[Array, "N P"]
    """Its splats in the light of its clip; belongs to the `LiveLook` until the next picture."""


class LiveLook:
    """The live colours of one performer; belongs to one thread."""

    def __init__(self, model: SplatModel) -> None:
        self._model = model
        self._aligner = FlowAligner(model)
        self._renderer, self._work = SplatRenderer((model,)), Workspace(len(model))
        self._joints = model.joints.astype(np.uint16)
        self._limbs = limb_splats(model.joints, model.weights)
        self._change = np.zeros((len(model), 3), np.float32)
        self._near = _neighbours(model)
        self._share = np.zeros(len(model), np.float32)
        """How much of its live colour each splat shows."""
        self._shown = np.zeros(len(model), np.float32)
        """How well each splat is seen in the newest picture."""
        self._seen_s = np.full(len(model), -np.inf)
        self._exposure: Float[Array, "3"] | None = None
        self._gathered = np.zeros((1, len(model), GATHERED), np.float32)
        self._time_s: float | None = None

    def see(self, picture: WebcamPicture) -> tuple[Pose, LiveAppearance]:
        """Take the colours of `picture`; returns its pose, aligned with it, and how its person
        looks."""
        aligned = self.align(picture)
        return aligned.pose, self.take_colours(picture, aligned)

    def align(self, picture: WebcamPicture) -> AlignedModel:
        """Bring the pose of `picture` to what it shows. To be called of each picture, in order."""
        skeleton, camera = self._model.skeleton, picture.camera
        given = picture.pose
        transforms = skeleton.skinning_transforms(given.joint_angles, given.root_translation)
        captured = self._renderer.shaded(
            camera, transforms.astype(np.float32), expressions=[given.expression]
        )
        # by the trained colours: live ones agree with whatever pose they were taken in
        return AlignedModel(self._aligner.align(picture, captured), captured)

    def take_colours(self, picture: WebcamPicture, aligned: AlignedModel) -> LiveAppearance:
        """Take the colours of `picture`, with which the model was aligned; returns how its person
        looks then."""
        base = aligned.captured[:, _COLOURS].copy()
        small = picture.resized(min(1.0, _COLOURS_PX / max(picture.matte.shape)))
        time_s = aligned.pose.time_s
        passed_s = _COMES_S if self._time_s is None else max(time_s - self._time_s, 0.0)
        self._time_s = time_s
        self._arrange(aligned.captured, small.camera, aligned.pose)
        drawn = self._drawn(base, small)
        self._follow_exposure(exposure_beside(small, drawn), passed_s)
        wanted = cored(small, drawn, self._exposure_now)
        self._find_colours(wanted, base, float(small.camera.intrinsics[0, 0]))
        self._follow(time_s, passed_s)
        change = self.change_at(time_s)
        return LiveAppearance(change, self._laid_picture(picture, aligned, change))

    def change_at(self, time_s: float) -> Float[Array, "N 3"]:
        """What is added to the splats' colours as they were captured, sRGB, at `time_s` of the
        webcam's clock."""
        from renderer.live_look.spreading_kernels import spread

        share = self._share * _held(time_s - self._seen_s)
        base = self._model.parameters[:, _COLOURS]
        exposed = (self._exposure_now - 1.0) * base
        shown = np.empty_like(self._change)
        spread(self._change, share, exposed, self._near, shown)
        return shown

    def _laid_picture(
        self, picture: WebcamPicture, aligned: AlignedModel, change: Float[Array, "N 3"]
    ) -> LaidPicture:
        """What `picture`, whose colours were taken, shows beyond those that `change` brings."""
        work = self._work
        self._arrange(aligned.captured, picture.camera, aligned.pose)
        colours = self._renderer.changed_colours(aligned.captured, [change])
        drawn = self._drawn(colours, picture)
        shown = np.minimum(self._shown, self._share)[:, None]
        places = np.concatenate([work.projected[:, MEAN_X : MEAN_Y + 1] * shown, shown], axis=1)
        skeleton, pose = self._model.skeleton, aligned.pose
        chest = skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)[CHEST]
        webcam = chest[:3, :3].T @ (picture.camera.position - chest[:3, 3])
        focal_px = float(picture.camera.intrinsics[0, 0])
        return LaidPicture(detail_of(picture, drawn), places, webcam, focal_px)

    def _arrange(self, shown: Float[Array, "N P"], camera: Camera, pose: Pose) -> None:
        """Hand the splats, posed, to the tiles of a picture."""
        transforms = self._model.skeleton.skinning_transforms(
            pose.joint_angles, pose.root_translation
        )
        self._work.arrange(
            shown,
            self._joints,
            self._model.weights,
            transforms.astype(np.float32),
            pack_camera(camera),
            camera.width,
            camera.height,
            BOX_FILTER_PX2,
        )

    def _drawn(self, colours: Float[Array, "N 3"], picture: WebcamPicture) -> Float[Array, "H W 4"]:
        """What the splats, as they are arranged, come to in `colours`, premultiplied."""
        import numba

        from renderer.splats.rasteriser.tile_kernels import draw

        work = self._work
        work.projected[:, RED : BLUE + 1] = colours
        drawn = np.empty((*picture.matte.shape, 4), np.float32)
        draw(work.projected, work.starts, work.entries, numba.get_num_threads(), drawn)
        return drawn

    def _find_colours(
        self, wanted: Float[Array, "H W 4"], base: Float[Array, "N 3"], focal_px: float
    ) -> None:
        """Steps towards the colours with which pixels are nearest to what is `wanted` (`cored`)."""
        from renderer.splats.rasteriser.backprojection_kernels import gather_differences

        work, size = self._work, (wanted.shape[0], wanted.shape[1])
        self._change *= _KEPT
        behind = hidden_by_limbs(work, self._limbs, size, focal_px)
        behind |= hidden_by_body(work, self._limbs, size)
        for _ in range(_STEPS):
            work.projected[:, RED : BLUE + 1] = base + self._change
            self._gathered[:] = 0.0
            gather_differences(
                work.projected, work.starts, work.entries, wanted, _MOST, self._gathered
            )
            found = self._gathered[0]
            step = found[:, DIFFERENCE : DIFFERENCE + 3] / (found[:, KNOWN] + _LEAST_PX)[:, None]
            step[behind] = 0.0
            self._change += _OVERSTEP * step
        np.clip(self._change, -base, 1.0 - base, out=self._change)
        self._gathered[0, behind, KNOWN] = 0.0

    @property
    def _exposure_now(self) -> Float[Array, "3"]:
        return np.ones(3, np.float32) if self._exposure is None else self._exposure

    def _follow_exposure(self, found: Float[Array, "3"] | None, passed_s: float) -> None:
        """Bring the exposure nearer to the newest picture's; the first is taken as it is."""
        if found is None:
            return
        before = found if self._exposure is None else self._exposure
        share = np.float32(min(1.0, passed_s / _EXPOSURE_S))
        self._exposure = before + share * (found - before)

    def _follow(self, time_s: float, passed_s: float) -> None:
        """Note what was seen."""
        found = self._gathered[0]
        shown = shown_pixels(self._work, found[:, SHOWN])
        shown *= found[:, KNOWN] / np.maximum(found[:, SHOWN], 1e-6)
        open_px = float(np.percentile(shown[shown > 0.0], _OPEN)) if shown.any() else 1.0
        wanted = np.clip(shown / (_SEEN * open_px), 0.0, 1.0)
        most = passed_s / _COMES_S
        self._shown += np.clip(wanted - self._shown, -most, most)
        self._shown[shown == 0.0] = 0.0
        seen = wanted > _HARDLY
        came = ~seen & (_held(time_s - self._seen_s) <= 0.0)
        self._share[came] = 0.0
        rising = np.maximum(wanted, self._share) - self._share
        self._share += np.minimum(rising, most).astype(np.float32)
        self._seen_s[seen] = time_s


def _neighbours(model: SplatModel) -> Int[Array, "N M"]:
    from scipy.spatial import KDTree

    rest = model.parameters[:, POSITION : POSITION + 3]
    count = min(_NEIGHBOURS, len(rest))
    _, near = KDTree(rest).query(rest, k=count)
    return np.reshape(near, (len(rest), count)).astype(np.int32)


def _held(age_s: Float[Array, "N"]) -> Float[Array, "N"]:
    """Share of a live colour that is left so long after it was seen."""
    gone = np.clip((age_s - _HELD_S) / _GONE_S, 0.0, 1.0)
    return (1.0 - gone * gone * (3.0 - 2.0 * gone)).astype(np.float32)
