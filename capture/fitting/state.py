"""The unknowns of one clip and the energy that the fit makes small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from capture.body.inverse_kinematics import TO_Y_UP, solve_translation
from capture.body.landmarks import MIRROR, LandmarkModel, place_landmarks
from capture.body.model import BodyModel
from capture.detection.landmarks import FACE_LANDMARKS, LANDMARK_NAMES, Landmarks
from capture.detection.lifter import Lifted, Lifter
from capture.fitting.kinematics import (
    forward,
    pose_prior,
    project,
    rigid_points,
    robust,
    rotation_matrices,
    sliding,
    time_steps,
    unsteadiness,
    very_robust,
)
from capture.fitting.observations import (
    Fit,
    beyond_hidden,
    bridged,
    hardly_shown,
    hidden_joints,
    landmark_arrays,
    person_height_px,
    without_gaps,
)
from capture.fitting.surface import Skin
from capture.fitting.terms.floor import Floor
from capture.fitting.terms.flow import (
    Aims,
    Pictures,
    find_flow,
    flow_energy,
    look_up,
    seen_vertices,
    strides_of,
)
from capture.fitting.terms.silhouette import Silhouettes, prepare_silhouettes, silhouette_energy
from scene.arrays import Array, Bool, Float, Tensor, UInt8
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import JOINT_COUNT

USUAL_FOCAL = 0.87
"""Focal length of phones and webcams, in longest sides of the picture (60 degrees)."""
_FOCAL_DEVIATION = 0.12
"""Of the logarithm of the focal length."""
_SHAPE_DEVIATION = (0.06, 0.2, 0.2, 0.2, 0.2)
"""Of height (in 1.03 m), weight, gender, muscle, proportions."""
_HABIT_RAD, _HABIT_WEIGHT = 0.25, 0.05
"""How far somebody's way of holding a joint lies from what the network takes for usual; the weight
is once a clip, beside the frames' mean energy."""
_SHAPE_WEIGHT = 0.5
"""Of the shape's prior, once a clip, beside the frames' mean energy."""
_FARTHEST_SHAPE, _SHAPE_WALL = 0.5, 0.05
"""Where the body model ends, and how softly: loose clothes would make it something else."""
_CLOTHES_DEVIATION_M = 0.01
"""Of how far a clip's outlines lie from the skin."""
_ACCELERATION_M_S2, _PLANTED_M_S = 9.0, 0.2
"""Of joints, and of feet that stand, with what the noise of a pose adds."""
_USUAL_RATE = 15.0
"""Frames a second up to which these hold; beyond, they grow with the rate: frames so close would
hold each other by its fourth power, and the steps of a fit so stiff creep."""
_WORLD_DEVIATION_M = 0.07
_OFFSET_DEVIATION_M = 0.01
_PIXEL_DEVIATION = 0.016
"""Of a landmark, in heights of the person."""
_EDGE_DEVIATION = 0.008
"""Of a silhouette, in the same."""
_OUTLIER = 3.0
"""Deviations from which a landmark has no say, once the outline has one."""
_LIFTED_WEIGHT, _WORLD_WEIGHT, _PRIOR_WEIGHT = 5.0, 0.05, 0.1
"""Of the network's poses, the 3D landmarks and the prior, beside the seen landmarks' sum."""
_EDGE_WEIGHT = 18.0
"""Of the outline's mean energy, beside the landmarks' sum."""
_FLOW_DEVIATION = 0.004
"""Of how far the surface moves between two pictures, in heights of the person."""
_FLOW_WEIGHT = 120.0
"""Of the flow's mean energy, beside the landmarks' sum."""
_CELL = 0.03
"""Side of a cell in which near vertices hide far ones, in heights of the person."""
_FACE_DEPTH_TRUST = 0.3
"""Of the face's 3D landmarks, beside the others': the estimator pulls heads towards the camera."""
_FAR_OFF = 4.0
"""Median energies of an outline from which a frame's landmarks are taken for something else's: the
estimator puts crouching people into half of themselves, and backs before fronts."""
_DOUBTED = 0.1
"""Weight of what the estimator says of such a frame."""
_VERTEX_SPACING_M = 0.065
_RIM_SPACING_M = 0.025
"""Of the vertices that outlines are looked up among: coarser ones leave gaps of pixels."""


@dataclass(frozen=True, eq=False)
class Look:
    """What the pictures say of the present poses; looked up every few steps only."""

    nearest: Tensor
    """Index [F P] of the rim's vertex that makes each point of the outline."""
    aims: Aims | None
    """Where the flow wants the vertices."""


class Problem:
    """Data and unknowns of one clip, as tensors."""

    def __init__(
        self,
        people: Sequence[Landmarks],
        masks: Sequence[Float[Array, "H W"] | None],
        times_s: Float[Array, "F"],
        takes: Array,
        model: BodyModel,
        focal_px: float | None,
        height_m: float | None,
        lifter: Lifter,
        images: Sequence[UInt8[Array, "H W 3"]] | None,
    ) -> None:
        self.model, self.marks = model, place_landmarks(model)
        self.silhouettes: Silhouettes = prepare_silhouettes(masks)
        self.pictures = None if images is None else Pictures(images, masks)
        self.flow = None
        self.width, self.height = self.silhouettes.width, self.silhouettes.height
        self.centre = torch.tensor([0.5 * self.width, 0.5 * self.height])
        self.focal_known = focal_px is not None
        self.height_m = height_m
        self.focal0 = focal_px or USUAL_FOCAL * max(self.width, self.height)
        self.pixels, self.world, self.weights = landmark_arrays(people, self.width, self.height)
        self.times_s, self.takes = times_s, np.asarray(takes)
        self.lifted = self._lift(people, lifter)
        self.steps = time_steps(times_s, takes)
        self.step_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1.0
        self.looseness = max(1.0, 1.0 / (_USUAL_RATE * self.step_s))
        self.belief = torch.ones(len(people))
        self.extent = person_height_px(self.pixels)
        self._tensors(self.marks)
        self._start()

    def _lift(self, people: Sequence[Landmarks], lifter: Lifter) -> Lifted:
        centre = np.array([0.5 * self.width, 0.5 * self.height])
        return lifter(*without_gaps(people, self.times_s, self.takes), self.focal0, centre)

    def _tensors(self, marks: LandmarkModel) -> None:
        def tensor(value: Array) -> Tensor:
            return torch.tensor(value, dtype=torch.float32)

        model = self.model
        self.joints0, self.joints1 = tensor(model.rest_joints), tensor(model.joint_directions)
        self.marks0, self.marks1 = tensor(marks.rest), tensor(marks.directions)
        self.mark_joints = torch.tensor(marks.joints)
        self.skin = Skin.of(model, _VERTEX_SPACING_M)
        self.rim = Skin.of(model, _RIM_SPACING_M)
        self.seen_pixels, self.seen_weights = tensor(self.pixels), tensor(self.weights)
        self.seen_world = tensor(self.world * TO_Y_UP)
        self.lifted_turns = tensor(self.lifted.rotations)
        self.lifted_spread = tensor(self.lifted.spread_rad)
        self.mirror = torch.tensor(MIRROR)
        self.depth_trust = torch.ones(len(LANDMARK_NAMES))
        self.depth_trust[:FACE_LANDMARKS] = _FACE_DEPTH_TRUST
        hidden = hidden_joints(self.weights)
        self.prior, self.hidden = pose_prior(), tensor(hardly_shown(hidden))
        shown = 1.0 - beyond_hidden(hidden)
        self.shown = tensor(shown[:, self.skin.owners.numpy()])
        self.floor = Floor(model, tensor(shown))

    def _start(self) -> None:
        angles, pelvis = start_poses(self)
        self.root0 = torch.tensor(axis_angle_to_matrix(angles[:, 0]), dtype=torch.float32)
        body = torch.tensor(angles, dtype=torch.float32)
        body[:, 0] = 0.0
        self.angles = body.requires_grad_()
        self.pelvis = torch.tensor(pelvis, dtype=torch.float32).requires_grad_()
        self.shape = torch.zeros(self.model.shape_count, requires_grad=True)
        self.log_focal = torch.zeros((), requires_grad=True)
        self.log_scale = torch.zeros((), requires_grad=True)
        self.clothes_m = torch.zeros((), requires_grad=True)
        self.habits = torch.zeros(JOINT_COUNT, 3, requires_grad=True)
        self.offsets = torch.zeros(len(LANDMARK_NAMES), 3, requires_grad=True)

    def doubted(self) -> Bool[Array, "F"]:
        """Frames whose outline lies far off the mask's, beside the others' of the clip."""
        edges = self.edges()
        return edges > _FAR_OFF * np.median(edges)

    @torch.no_grad()
    def watch(self, *, coarse: bool) -> None:
        """Find the floor, and the flow between the pictures, from the present motion."""
        posed = self.posed()
        self.floor.find(*posed, self.shape)
        if self.pictures is not None:
            skin, pixels = self._surface(*posed)
            seen = self._seen(posed[0], skin, pixels)
            self.flow = find_flow(
                self.pictures,
                self.takes,
                strides_of(self.step_s),
                pixels.numpy(),
                seen.numpy(),
                coarse=coarse,
            )

    @torch.no_grad()
    def look(self) -> Look:
        """What outlines and flow say of the present poses."""
        posed = self.posed()
        aims = None
        if self.flow is not None:
            skin, pixels = self._surface(*posed)
            aims = look_up(self.flow, pixels, self._seen(posed[0], skin, pixels))
        return Look(self._nearest(*posed), aims)

    def _seen(self, turned: Tensor, skin: Tensor, pixels: Tensor) -> Tensor:
        normals = self.skin.turned_normals(turned)
        return seen_vertices(skin, pixels, normals, _CELL * self.extent)

    def _nearest(self, turned: Tensor, placed: Tensor, rest: Tensor) -> Tensor:
        rim = self.rim.posed(turned, placed, rest, self.shape)
        normals = self.rim.turned_normals(turned)
        pixels = project(rim, self.focal(), self.centre)
        return self.silhouettes.nearest(pixels, normals, rim)

    @torch.no_grad()
    def edges(self) -> Float[Array, "F"]:
        """Energy of each frame's outline (`silhouette_energy`)."""
        posed = self.posed()
        _, pixels = self._surface(*posed)
        return self._edge_energy(self._nearest(*posed), pixels, *posed).numpy()

    @torch.no_grad()
    def let_go(self, frames: Bool[Array, "F"]) -> None:
        """Take the poses of `frames` from their neighbours in the same take, and hardly believe
        any more what the estimator says of them."""
        turned = matrix_to_axis_angle(self.rotations().numpy().astype(np.float64))
        for take in np.unique(self.takes[frames]):
            here = np.flatnonzero(self.takes == take)
            kept, doubted = here[~frames[here]], here[frames[here]]
            if not len(kept):
                continue
            angles, pelvis = bridged(kept, turned[kept], self.pelvis.numpy()[kept], self.times_s)
            body = torch.tensor(angles[doubted], dtype=torch.float32)
            self.root0[doubted] = rotation_matrices(body[:, 0])
            body[:, 0] = 0.0
            self.angles[doubted] = body
            self.pelvis[doubted] = torch.tensor(pelvis[doubted], dtype=torch.float32)
            self.belief[doubted] = _DOUBTED

    def rotations(self) -> Tensor:
        """Local rotations [F 24 3 3]; the root's is the start's, turned by the first angle."""
        local = rotation_matrices(self.angles)
        return torch.cat([(self.root0 @ local[:, 0])[:, None], local[:, 1:]], 1)

    def posed(self) -> tuple[Tensor, Tensor, Tensor]:
        """World rotations, joints [F 24 3] and rest joints."""
        rest = self.joints0 + self.joints1 @ self.shape
        turned, placed = forward(self.rotations(), self.pelvis, rest)
        return turned, placed, rest

    def focal(self) -> Tensor:
        return self.focal0 * torch.exp(self.log_focal)

    def landmarks(self, turned: Tensor, placed: Tensor, rest: Tensor) -> Tensor:
        """The model's landmarks [F 33 3], offsets mirrored between the sides."""
        mirrored = self.offsets[self.mirror] * torch.tensor([-1.0, 1.0, 1.0])
        points = self.marks0 + self.marks1 @ self.shape + 0.5 * (self.offsets + mirrored)
        return rigid_points(turned, placed, rest, points, self.mark_joints)

    def _surface(self, turned: Tensor, placed: Tensor, rest: Tensor) -> tuple[Tensor, Tensor]:
        """The sampled vertices [F V 3] and their pixels [F V 2]."""
        skin = self.skin.posed(turned, placed, rest, self.shape)
        return skin, project(skin, self.focal(), self.centre)

    def energy(self, look: Look | None) -> Tensor:
        """Mean over frames of all terms; outlines and flow join in with a `look` at them."""
        turned, placed, rest = self.posed()
        marks = self.landmarks(turned, placed, rest)
        off = (project(marks, self.focal(), self.centre) - self.seen_pixels) / (
            _PIXEL_DEVIATION * self.extent
        )
        kernel = robust if look is None else lambda squared: very_robust(squared, _OUTLIER)
        seen = (kernel(off.square().sum(-1)) * self.seen_weights).sum(1)
        depth = self._world_energy(marks)
        steady = unsteadiness(placed, *self.steps, self.looseness * _ACCELERATION_M_S2)
        total = (
            (self.belief * (seen + _WORLD_WEIGHT * depth)).mean()
            + _PRIOR_WEIGHT * self.prior.energy(self.angles, self.hidden).mean()
            + _LIFTED_WEIGHT * (self.belief * self._lifted_energy()).mean()
            + steady.sum() / len(placed)
            + sliding(placed, self.steps[0], self.looseness * _PLANTED_M_S)
        )
        total = total + self._once_a_clip()
        if look is not None:
            _, pixels = self._surface(turned, placed, rest)
            edges = self._edge_energy(look.nearest, pixels, turned, placed, rest)
            total = total + _EDGE_WEIGHT * edges.mean()
            total = total + self.floor.energy(turned, placed, rest, self.shape)
            if look.aims is not None:
                flow = flow_energy(look.aims, pixels, _FLOW_DEVIATION * self.extent)
                total = total + _FLOW_WEIGHT * flow
        return total

    def _edge_energy(
        self, nearest: Tensor, pixels: Tensor, turned: Tensor, placed: Tensor, rest: Tensor
    ) -> Tensor:
        rim = self.rim.posed_at(nearest, turned, placed, rest, self.shape)
        reached = project(rim, self.focal(), self.centre)
        clothes_px = self.focal() * self.clothes_m / -placed[:, 0, 2].clamp_max(-0.1)
        deviation = _EDGE_DEVIATION * self.extent
        return silhouette_energy(
            self.silhouettes, pixels, reached, self.shown, clothes_px, deviation
        )

    def _lifted_energy(self) -> Tensor:
        """Away from the poses that the network believes, in its own usual errors [F].

        Frame by frame it draws everybody towards the usual; how somebody holds their head all
        along shows in the whole clip only, so the same turn in all frames costs next to nothing.
        """
        # |R - S|^2 = 8 sin^2(angle / 2), twice the squared angle where that is small
        believed = self.lifted_turns @ rotation_matrices(self.habits)
        off = 0.5 * (self.rotations() - believed).square().sum((-1, -2))
        return (robust(off / self.lifted_spread.square()) * (1.0 - self.hidden)).sum(1)

    def _world_energy(self, marks: Tensor) -> Tensor:
        """Off the estimator's 3D landmarks [F], whose size is its own guess: one scale a clip."""
        weight = (self.seen_weights * self.depth_trust)[..., None]
        total = weight.sum(1, keepdim=True).clamp_min(1e-6)
        ours = marks - (marks * weight).sum(1, keepdim=True) / total
        theirs = self.seen_world - (self.seen_world * weight).sum(1, keepdim=True) / total
        off = (ours - theirs * torch.exp(self.log_scale)) / _WORLD_DEVIATION_M
        return (robust(off.square().sum(-1)) * weight[..., 0]).sum(1)

    def _once_a_clip(self) -> Tensor:
        shape = (self.shape / torch.tensor(_SHAPE_DEVIATION)).square().sum()
        beyond = torch.relu(self.shape.abs() - _FARTHEST_SHAPE) / _SHAPE_WALL
        offsets = (self.offsets / _OFFSET_DEVIATION_M).square().sum()
        return (
            _HABIT_WEIGHT * (self.habits / _HABIT_RAD).square().sum()
            + _SHAPE_WEIGHT * shape
            + beyond.square().sum()
            + 0.5 * (self.clothes_m / _CLOTHES_DEVIATION_M) ** 2
            + 0.1 * offsets
            + 0.5 * (self.log_focal / _FOCAL_DEVIATION).square()
        )

    def result(self) -> Fit:
        """The fit, as tall as the person told."""
        with torch.no_grad():
            turned, placed, rest = self.posed()
            marks = self.landmarks(turned, placed, rest)
            off = project(marks, self.focal(), self.centre) - self.seen_pixels
            error = off.norm(dim=-1).numpy().astype(np.float64)
            angles = matrix_to_axis_angle(self.rotations().numpy().astype(np.float64))
            shape, floor = self.shape.numpy().astype(np.float64), self.floor.found()
            model = self.model
            tall = np.ptp(model.rest_vertices[:, 1] + model.vertex_directions[:, 1] @ shape)
            # about the camera, so that pictures stay the same
            scale = 1.0 if self.height_m is None else self.height_m / float(tall)
            return Fit(
                model.body(shape, scale),
                float(self.focal()),
                angles,
                scale * self.pelvis.numpy().astype(np.float64),
                np.where(self.weights > 0.0, error, np.nan),
                self.weights,
                None if floor is None else floor * [1.0, 1.0, 1.0, scale],
            )


def start_poses(problem: Problem) -> tuple[Array, Array]:
    """Closed-form poses [F 24 3] and pelvis places [F 3], m."""
    rotations = problem.lifted_turns
    angles = matrix_to_axis_angle(problem.lifted.rotations)
    with torch.no_grad():
        turned, placed = forward(rotations, torch.zeros(len(angles), 3), problem.joints0)
        marks = rigid_points(turned, placed, problem.joints0, problem.marks0, problem.mark_joints)
    focal, centre = problem.focal0, problem.centre.numpy()
    intrinsics = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
    points = marks.numpy().astype(np.float64) * TO_Y_UP
    shift = solve_translation(points, problem.pixels, problem.weights, intrinsics)
    return angles, shift * TO_Y_UP
