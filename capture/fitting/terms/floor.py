"""Floor contact: where up is, and the plane that people stand on.

One fixed camera doesn't know gravity, but people stand upright: in frames where trunk and legs are
in line, the line from the ankles to the neck is close to the vertical. Where no legs are seen, the
trunk and the picture's own up share the word, since a trunk's lean in depth is the estimator's
weakest guess.

The floor is one plane a clip: the sole of the lower foot lies on it, nothing sinks into it, and
jumps are beyond its pull.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import torch

from capture.body.inverse_kinematics import unit
from capture.body.model import BodyModel
from capture.fitting.observations import Observations
from capture.fitting.robust import geman_mcclure
from capture.fitting.state import FitBody, FitState, PosedClip
from capture.fitting.surface import SurfaceSamples
from capture.fitting.term import Term
from scene.arrays import Array, Float, Int, Tensor
from scene.skeleton import JOINT_NAMES

_STRAIGHT_RAD = np.deg2rad(12.0)
_MEDIAN_ROUNDS = 30
_SOLE_M, _BALL = 0.012, 0.6
"""How far above a foot's lowest vertex its sole ends, and the share of the sole behind the ball."""
_DEVIATION_M, _OUTLIER = 0.02, 2.0
"""Of a sole that stands, and deviations from which it is in the air."""
_SUNK_M, _FAR_SUNK = 0.01, 6.0
"""The same of a sole below the floor."""
_STANDS, _SINKS = 8.0, 1.0
"""Weight of the lower foot's mean energy, and of each place below the floor."""
_LEAN = 0.07
"""Deviation of the floor's slopes from what stands upright on it."""
_SLOPES_X, _SLOPES_Z = np.linspace(-0.15, 0.15, 7), np.linspace(-0.2, 0.2, 9)
"""Beside the upright ones."""
_LOW = (0.1, 0.25, 0.4, 0.55)
"""Shares of the frames whose lowest soles may be below the floor, as it is looked for."""
_SEEN, _LEVEL = 0.5, 0.5
"""Share of the frames that must show feet, and the cosine between up and the picture's own from
which a camera looks too steeply down for slopes."""
_PLACES = 4
"""A foot's: heel, toes, and the ball on both sides."""

_J = {name: index for index, name in enumerate(JOINT_NAMES)}


def upward(joints: Float[Array, "F 24 3"]) -> Float[Array, "3"]:
    """The vertical (unit) in the camera frame, from joint positions of a person mostly upright,
    whose legs are seen."""
    neck, pelvis = joints[:, _J["neck"]], joints[:, _J["pelvis"]]
    trunk = unit(neck - pelvis)
    ankles = 0.5 * (joints[:, _J["left_ankle"]] + joints[:, _J["right_ankle"]])
    legs = unit(pelvis - ankles)
    bend = np.arccos(np.clip((trunk * legs).sum(1), -1.0, 1.0))
    straight = np.exp(-((bend / _STRAIGHT_RAD) ** 2)) + 1e-3
    return _median_direction(unit(neck - ankles), straight)


def sole_vertices(model: BodyModel) -> Int[Array, "8"]:
    """`_PLACES` vertices under the left foot, then those under the right."""
    rest, owners = model.rest_vertices, model.blend_weights.argmax(axis=1)
    chosen: list[Int[Array, ""]] = []
    for side in ("left", "right"):
        foot = np.flatnonzero(np.isin(owners, [_J[f"{side}_ankle"], _J[f"{side}_foot"]]))
        sole = foot[rest[foot, 1] < rest[foot, 1].min() + _SOLE_M]
        z = rest[sole, 2]
        ball = sole[z > np.quantile(z, _BALL)]
        chosen += [
            sole[z.argmin()],
            sole[z.argmax()],
            ball[rest[ball, 0].argmin()],
            ball[rest[ball, 0].argmax()],
        ]
    return np.array(chosen)


class FloorContact(Term):
    """The lower foot's sole lies on one plane, nothing sinks into it; none where no floor shows.

    Points are counted from `FitState.floor_origin`, the middle of the person's positions.
    """

    def __init__(self, body: FitBody, seen: Observations) -> None:
        super().__init__(body, seen)
        chosen = sole_vertices(body.model)
        rest = body.model.rest_vertices
        self._soles = SurfaceSamples.at(body.model, chosen)
        arch_m = rest[chosen, 1] - rest[:, 1].min()
        self._arch = torch.tensor([0.0, 1.0, 0.0]) * torch.tensor(arch_m[:, None]).float()
        self._shown = seen.shown[:, self._soles.owners]
        self._upright: Tensor | None = None

    def prepare(self, clip: PosedClip, *, coarse: bool) -> None:
        """Look for the floor; there is none where feet are hardly seen, nor straight from above."""
        state, joints = clip.state, clip.posed.joint_positions
        self._upright = state.floor_origin = None
        up = upward(joints.numpy().astype(np.float64))
        if self._shown.mean() < _SEEN or up[1] < _LEVEL:
            return
        self._upright = torch.tensor([-up[0] / up[1], -up[2] / up[1]], dtype=torch.float32)
        state.floor_origin = joints[:, 0].mean(0)
        soles = self._soles_of(clip, state.floor_origin)
        state.floor_plane[:] = find_floor(soles, self._shown, self._upright)

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        """Of soles off the floor, and of a floor on which nobody would stand upright."""
        state = clip.state
        if self._upright is None or state.floor_origin is None:
            return torch.zeros(())
        heights = above(self._soles_of(clip, state.floor_origin), state.floor_plane)
        return floor_energy(heights, self._shown) + lean_energy(state.floor_plane, self._upright)

    def _soles_of(self, clip: PosedClip, origin: Tensor) -> Float[Tensor, "F 8 3"]:
        """The soles, as low as a foot's lowest vertex where it stands flat."""
        return self._soles.posed(clip.posed) - origin - self._arch


def floor_of(state: FitState) -> Float[Array, "4"] | None:
    """Normal (unit, up) and distance along it, m, where a floor was found."""
    if state.floor_origin is None:
        return None
    a, b, c = state.floor_plane.tolist()
    up = unit(np.array([-a, 1.0, -b]))
    below = state.floor_origin.numpy() + np.array([0.0, c, 0.0])
    return np.append(up, up @ below)


def above(points: Float[Tensor, "F P 3"], plane: Float[Tensor, "3"]) -> Float[Tensor, "F P"]:
    """How far `points` are above the plane a, b, c, m."""
    x, y, z = points.unbind(-1)
    a, b, c = plane
    return (y - a * x - b * z - c) / (1.0 + a * a + b * b).sqrt()


def floor_energy(heights: Float[Tensor, "F 8"], shown: Float[Tensor, "F 8"]) -> Tensor:
    """Mean over frames of how far soles of `heights` miss the floor, as far as they are `shown`."""
    off = geman_mcclure((heights / _DEVIATION_M).square(), _OUTLIER) * shown
    feet = off.unflatten(1, (2, _PLACES)).mean(2)
    lowest = heights.detach().unflatten(1, (2, _PLACES)).amin(2)
    left = (lowest[:, 0] <= lowest[:, 1]).float()
    stands = torch.stack([left, 1.0 - left], 1)
    sunk = geman_mcclure((torch.relu(-heights) / _SUNK_M).square(), _FAR_SUNK) * shown
    return (_STANDS * (feet * stands).sum(1) + _SINKS * sunk.sum(1)).mean()


def lean_energy(plane: Float[Tensor, "3"], upright: Float[Tensor, "2"]) -> Tensor:
    """How far the plane's slopes are from those on which people would stand `upright`."""
    return 0.5 * ((plane[:2] - upright) / _LEAN).square().sum()


def find_floor(
    points: Float[Tensor, "F 8 3"], shown: Float[Tensor, "F 8"], upright: Float[Tensor, "2"]
) -> Float[Tensor, "3"]:
    """The plane with the least energy among some about `upright`."""
    best, found = torch.inf, torch.zeros(3)
    for da, db in product(_SLOPES_X, _SLOPES_Z):
        a, b = float(upright[0]) + da, float(upright[1]) + db
        slanted = float(np.sqrt(1.0 + a * a + b * b))
        heights = above(points, torch.tensor([a, b, 0.0]))
        lowest = heights.masked_fill(shown < 0.5, torch.inf).amin(1)
        for level in np.quantile(lowest[torch.isfinite(lowest)].numpy(), _LOW):
            plane = torch.tensor([a, b, float(level) * slanted])
            energy = floor_energy(heights - float(level), shown) + lean_energy(plane, upright)
            if float(energy) < best:
                best, found = float(energy), plane
    return found


def _median_direction(directions: Array, weights: Array) -> Array:
    """Geometric median on the sphere (Weiszfeld): a minority that leans has no pull."""
    middle = unit(np.average(directions, axis=0, weights=weights))
    for _ in range(_MEDIAN_ROUNDS):
        near = weights / np.maximum(np.linalg.norm(directions - middle, axis=1), 1e-3)
        middle = unit((directions * near[:, None]).sum(axis=0))
    return middle
